"""Runs a command in several processes of this machine, and watches over them."""

import contextlib
import dataclasses
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence

from rich import console as rich_console

from ..sim import ranges
from . import cluster, interrupts

STALL_SECONDS = 10.0  # without a pulse, after which a process counts as stalled
START_SECONDS = 60.0  # until the first pulse: importing takes its time
POLL_SECONDS = 0.2
SAID_WHY = (interrupts.AGAIN, 2, 130)  # exit codes of who has said why it ended
LAST_WORDS = 2_000  # characters of what a process that failed has said
RUN = "from drivetrain.launch.cli import main; main()"


@dataclasses.dataclass(frozen=True, kw_only=True)
class JobConfig:
    """In how many processes a command runs."""

    processes: int = 1
    devices_per_process: int | None = None
    restarts: int = 0

    def __post_init__(self) -> None:
        """Checks the counts.

        Raises:
            ValueError: if one is out of range.
        """
        ranges.require_at_least(self, processes=1, restarts=0)
        if self.devices_per_process is not None:
            ranges.require_at_least(self, devices_per_process=1)


@dataclasses.dataclass(frozen=True)
class _Child:
    """One of the processes."""

    number: int
    process: subprocess.Popen[bytes]
    pulse: pathlib.Path
    words: pathlib.Path | None  # what it says on standard error; None: it is shown

    def last_words(self) -> str:
        """Returns the end of what it has said, if nobody has seen it."""
        if self.words is None:
            return ""
        return self.words.read_text(errors="replace")[-LAST_WORDS:].strip()


def run(words: Sequence[str], config: JobConfig) -> int:
    """Runs a command in several processes, and again where one of them fails.

    The exit of one with an error, its death and its silence end all of them. Ctrl-C
    and SIGTERM are passed on to each.

    Args:
        words: of the command, after `drivetrain`.
        config: in how many, with how many devices each, and how often again.

    Returns:
        The exit code.
    """
    restarts = 0
    while True:
        code, told = _once(words, config)
        if told:
            _say(told)
        if code in (0, *SAID_WHY) or restarts == config.restarts:
            return code
        restarts += 1
        _say(f"starting again, {restarts} of {config.restarts} times")


def _say(line: str) -> None:
    console = rich_console.Console(stderr=True, highlight=False, markup=False)
    console.print(f"drivetrain: {line}", soft_wrap=True)


def _once(words: Sequence[str], config: JobConfig) -> tuple[int, str]:
    """Runs the processes; returns the exit code for all, and what to tell."""
    address = f"localhost:{_free_port()}"
    with tempfile.TemporaryDirectory(prefix="drivetrain-") as folder:
        children = [
            _start(words, config, number, address, pathlib.Path(folder))
            for number in range(config.processes)
        ]
        try:
            with _passed_on(children):
                return _watch(children)
        finally:
            for child in children:
                child.process.kill()
                child.process.wait()


def _start(
    words: Sequence[str],
    config: JobConfig,
    number: int,
    address: str,
    folder: pathlib.Path,
) -> _Child:
    pulse, spoken = folder / f"pulse-{number}", folder / f"words-{number}"
    own = {
        cluster.COORDINATOR: address,
        cluster.PROCESSES: str(config.processes),
        cluster.PROCESS: str(number),
        cluster.PULSE: str(pulse),
    }
    if config.devices_per_process is not None:
        own[cluster.DEVICES] = str(config.devices_per_process)
    with spoken.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, *words],
            env=os.environ | own,
            stdout=None if number == 0 else subprocess.DEVNULL,
            stderr=None if number == 0 else file,
            start_new_session=True,  # so that Ctrl-C reaches it only from here
        )
    return _Child(number, process, pulse, None if number == 0 else spoken)


def _watch(children: Sequence[_Child]) -> tuple[int, str]:
    """Waits until all have ended, or one that must not."""
    began = time.time()
    while True:
        codes = [child.process.poll() for child in children]
        # First those that did not only lose another one.
        for child, code in sorted(
            zip(children, codes, strict=True), key=lambda pair: pair[1] == cluster.LOST
        ):
            wrong = _wrong(child, code, began)
            if wrong:
                told = f"process {child.number} of {len(children)} {wrong}; all end"
                return 1, "\n".join([told, child.last_words()]).strip()
        ended = [code for code in codes if code is not None]
        if 2 in ended or len(ended) == len(codes):
            return max(ended), ""
        time.sleep(POLL_SECONDS)


def _wrong(child: _Child, code: int | None, began: float) -> str | None:
    """Says what is wrong with a process that goes on, or has ended with a code."""
    if code is None:
        return "has stalled" if _is_stalled(child.pulse, began) else None
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return None if code in (0, *SAID_WHY) else f"failed with exit code {code}"


def _is_stalled(pulse: pathlib.Path, began: float) -> bool:
    try:
        last, limit = pulse.stat().st_mtime, STALL_SECONDS
    except FileNotFoundError:
        last, limit = began, START_SECONDS
    return time.time() - last > limit


@contextlib.contextmanager
def _passed_on(children: Sequence[_Child]) -> Iterator[None]:
    """Passes Ctrl-C and SIGTERM on to processes."""

    def pass_on(number: int, frame: object) -> None:
        for child in children:
            if child.process.poll() is None:
                child.process.send_signal(number)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, pass_on) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _free_port() -> int:
    with socket.socket() as found:
        found.bind(("localhost", 0))
        return found.getsockname()[1]
