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

from . import cluster, interrupts

STALL_SECONDS = 20.0  # without a pulse, after which a process counts as stalled
START_SECONDS = 60.0  # until the first pulse: importing takes its time
POLL_SECONDS = 0.2
SAID_WHY = (interrupts.AGAIN, 2, 130)  # exit codes of who has said why it ended
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
        if self.processes < 1:
            raise ValueError(f"processes must be at least 1, got {self.processes}.")
        if self.devices_per_process is not None and self.devices_per_process < 1:
            raise ValueError(
                f"devices-per-process must be at least 1, got "
                f"{self.devices_per_process}."
            )
        if self.restarts < 0:
            raise ValueError(f"restarts must be at least 0, got {self.restarts}.")


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a job ended: the exit code for all, and what to tell, if anything."""

    code: int
    told: str = ""


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
    say = rich_console.Console(stderr=True, highlight=False, markup=False).print
    restarts = 0
    while True:
        ended = _once(words, config)
        if ended.told:
            say(f"drivetrain: {ended.told}", soft_wrap=True)
        if ended.code in (0, *SAID_WHY) or restarts == config.restarts:
            return ended.code
        restarts += 1
        say(f"drivetrain: starting again, {restarts} of {config.restarts} times")


def _once(words: Sequence[str], config: JobConfig) -> Ended:
    with tempfile.TemporaryDirectory(prefix="drivetrain-") as folder:
        pulses = [pathlib.Path(folder) / str(i) for i in range(config.processes)]
        address = f"localhost:{_free_port()}"
        children = [
            _start(words, config, number, address, pulse)
            for number, pulse in enumerate(pulses)
        ]
        try:
            with _passed_on(children):
                return _watch(children, pulses)
        finally:
            for child in children:
                child.kill()
                child.wait()


def _start(
    words: Sequence[str],
    config: JobConfig,
    number: int,
    address: str,
    pulse: pathlib.Path,
) -> subprocess.Popen[bytes]:
    own = {
        cluster.COORDINATOR: address,
        cluster.PROCESSES: str(config.processes),
        cluster.PROCESS: str(number),
        cluster.PULSE: str(pulse),
    }
    if config.devices_per_process is not None:
        own[cluster.DEVICES] = str(config.devices_per_process)
    # In a session of its own: Ctrl-C reaches it through this process alone.
    return subprocess.Popen(
        [sys.executable, "-c", RUN, *words],
        env=os.environ | own,
        start_new_session=True,
    )


def _watch(
    children: Sequence[subprocess.Popen[bytes]], pulses: Sequence[pathlib.Path]
) -> Ended:
    """Waits until all have ended, or one that must not."""
    began = time.time()
    while True:
        codes = [child.poll() for child in children]
        for number, code in enumerate(codes):
            of = f"process {number} of {len(children)}"
            if code is None and _is_stalled(pulses[number], began):
                return Ended(1, f"{of} has stalled; all are ended")
            if code is not None and code < 0:
                name = signal.Signals(-code).name
                return Ended(1, f"{of} was killed by {name}; all are ended")
            if code not in (None, 0, *SAID_WHY):
                return Ended(1, f"{of} failed with exit code {code}; all are ended")
        ended = [code for code in codes if code is not None]
        if any(ended) and (2 in ended or len(ended) == len(codes)):
            return Ended(max(ended))
        if len(ended) == len(codes):
            return Ended(0)
        time.sleep(POLL_SECONDS)


def _is_stalled(pulse: pathlib.Path, began: float) -> bool:
    try:
        last, limit = pulse.stat().st_mtime, STALL_SECONDS
    except FileNotFoundError:
        last, limit = began, START_SECONDS
    return time.time() - last > limit


@contextlib.contextmanager
def _passed_on(children: Sequence[subprocess.Popen[bytes]]) -> Iterator[None]:
    """Passes Ctrl-C and SIGTERM on to processes."""

    def pass_on(number: int, frame: object) -> None:
        for child in children:
            if child.poll() is None:
                child.send_signal(number)

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
