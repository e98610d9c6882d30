"""Tests that one job at a time trains in a folder."""

import pathlib
import signal
import subprocess
import sys

import pytest

from drivetrain.launch import locks
from tests.launch.cli_test import TINY

HOLD = """
import fcntl, sys, time
file = open(sys.argv[1], "ab")
fcntl.flock(file, fcntl.LOCK_EX)
print("held", flush=True)
time.sleep(100)
"""


@pytest.fixture
def holder(tmp_path: pathlib.Path):
    """Another process, which holds the lock of the folder `run`."""
    (tmp_path / "run").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "run" / "lock")],
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == b"held\n"
    yield process
    process.kill()
    process.wait()


def test_a_second_job_is_refused(
    drivetrain, holder, tmp_path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locks, "PATIENCE_SECONDS", 0.0)
    (tmp_path / "tiny.yaml").write_text(TINY)
    assert drivetrain("train", "tiny.yaml", "--out", "run") == 2
    assert "another job trains in 'run'; wait for its end" in capsys.readouterr().err


def test_the_lock_of_one_that_was_killed_is_free(holder, tmp_path) -> None:
    holder.send_signal(signal.SIGKILL)
    with locks.held(tmp_path / "run"):
        pass


def test_who_has_ended_holds_it_no_more(tmp_path: pathlib.Path) -> None:
    for _ in range(2):
        with locks.held(tmp_path / "new" / "run"):
            assert (tmp_path / "new" / "run" / "lock").is_file()
