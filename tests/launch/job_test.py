"""Tests that a job of several processes is whole or ends."""

import pathlib
import signal
import textwrap
import threading
import time

import pytest

from drivetrain.launch import job
from drivetrain.launch.job import JobConfig

TWO = JobConfig(processes=2)


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path):
    """Returns what replaces the command; it knows `number`, `pulse` and `folder`."""

    def replace(script: str) -> None:
        head = f"""
            import os, pathlib, signal, sys, time
            number = int(os.environ["DRIVETRAIN_PROCESS"])
            pulse = pathlib.Path(os.environ["DRIVETRAIN_PULSE"])
            folder = pathlib.Path({str(tmp_path)!r})
        """
        whole = textwrap.dedent(head) + textwrap.dedent(script)
        monkeypatch.setattr(job, "RUN", whole)

    return replace


def test_each_process_knows_its_place(program, tmp_path: pathlib.Path) -> None:
    program("""
        names = ("COORDINATOR", "PROCESSES", "DEVICES")
        known = [os.environ["DRIVETRAIN_" + name] for name in names]
        (folder / str(number)).write_text(" ".join([*known, *sys.argv[1:]]))
    """)
    config = JobConfig(processes=3, devices_per_process=2)
    assert job.run(["train", "x.yaml"], config) == 0
    found = {(tmp_path / str(number)).read_text() for number in range(3)}
    (line,) = found  # they have one coordinator
    assert line.startswith("localhost:") and line.endswith(" 3 2 train x.yaml")


@pytest.mark.parametrize(
    ("last", "told"),
    [
        ("sys.exit('no such file')", "process 1 of 2 failed with exit code 1"),
        (
            "os.kill(os.getpid(), signal.SIGKILL)",
            "process 1 of 2 was killed by SIGKILL",
        ),
    ],
)
def test_one_that_fails_ends_all(program, capfd, last: str, told: str) -> None:
    program(f"""
        if number == 0:
            time.sleep(100)
        print("before the end", file=sys.stderr, flush=True)
        {last}
    """)
    began = time.monotonic()
    assert job.run([], TWO) == 1
    assert time.monotonic() - began < 30
    error = capfd.readouterr().err
    assert told in error and "before the end" in error


def test_who_has_lost_another_one_is_not_named(program, capfd) -> None:
    program("""
        if number == 0:
            sys.exit(69)
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    # Both have ended when the first look comes.
    job_start, started = job._start, []

    def slow(*args):
        child = job_start(*args)
        started.append(child)
        if len(started) == 2:
            for each in started:
                each.process.wait()
        return child

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(job, "_start", slow)
        assert job.run([], TWO) == 1
    assert "process 1 of 2 was killed by SIGKILL" in capfd.readouterr().err


def test_one_that_stalls_ends_all(
    program, capfd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job, "STALL_SECONDS", 2.0)
    program("""
        while True:
            if number == 0 or not pulse.exists():
                pulse.touch()
            time.sleep(0.1)
    """)
    assert job.run([], TWO) == 1
    assert "process 1 of 2 has stalled" in capfd.readouterr().err


def test_one_that_fails_is_started_again(program, capfd, tmp_path) -> None:
    program("""
        tries = folder / str(number)
        tries.write_text(tries.read_text() + "x" if tries.exists() else "x")
        sys.exit(number == 1 and tries.read_text() != "xxx")
    """)
    assert job.run([], JobConfig(processes=2, restarts=5)) == 0
    assert (tmp_path / "1").read_text() == "xxx"
    assert "starting again, 2 of 5 times" in capfd.readouterr().err


@pytest.mark.parametrize("code", [2, 75])
def test_who_says_why_it_ends_is_not_started_again(program, tmp_path, code) -> None:
    program(f"""
        (folder / str(number)).open("a").write("x")
        time.sleep(100 if number == 0 and {code} == 2 else 0)
        sys.exit({code})
    """)
    assert job.run([], JobConfig(processes=2, restarts=5)) == code
    assert (tmp_path / "1").read_text() == "x"


def test_sigterm_is_passed_on(program, tmp_path: pathlib.Path) -> None:
    program("""
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(75))
        (folder / f"ready-{number}").touch()
        time.sleep(100)
    """)

    def tell() -> None:
        while len(list(tmp_path.glob("ready-*"))) < 2:
            time.sleep(0.05)
        signal.raise_signal(signal.SIGTERM)

    telling = threading.Thread(target=tell)
    telling.start()
    assert job.run([], TWO) == 75
    telling.join()


@pytest.mark.parametrize(
    "fields", [{"processes": 0}, {"restarts": -1}, {"devices_per_process": 0}]
)
def test_counts_out_of_range_are_refused(fields: dict[str, int]) -> None:
    (name,) = fields
    with pytest.raises(ValueError, match=f"{name} must be at least"):
        JobConfig(**fields)
