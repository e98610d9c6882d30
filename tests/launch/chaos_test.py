"""Tests that a job that is killed again and again ends as one that nobody disturbs.

Run it with `pytest -m chaos`; it takes some ten minutes.
"""

import contextlib
import os
import pathlib
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from drivetrain.launch import job, logbook
from drivetrain.learners import checksums
from tests.launch import saved
from tests.launch.cli_test import TINY
from tests.launch.processes_test import FLAT, TOGETHER

KILLS = 30
UPDATES = 600
# A save after each call: most of the time one is under way.
OFTEN = (f"updates={UPDATES}", "updates_per_checkpoint=2")
LONGEST_SECONDS = 20.0  # between two kills; a job trains after about seven
POLL_SECONDS = 0.002
HARMLESS = (0, 1, 75, -signal.SIGKILL, -signal.SIGTERM)  # exit codes of who is killed


def start(folder: pathlib.Path, out: str) -> subprocess.Popen[bytes]:
    words = ("train", "tiny.yaml", *FLAT, *OFTEN, "--out", out, *TOGETHER)
    with (folder / f"{out}.txt").open("ab") as said:
        return subprocess.Popen(
            [sys.executable, "-c", job.RUN, *words, "--restarts", "100"],
            cwd=folder,
            stdout=said,
            stderr=said,
        )


def kill_one(launcher: int, chance: random.Random) -> str:
    """Kills the launcher or one of the processes it has started."""
    listed = pathlib.Path(f"/proc/{launcher}/task/{launcher}/children").read_text()
    victim = chance.choice([launcher, *map(int, listed.split())])
    number = chance.choice([signal.SIGKILL, signal.SIGTERM])
    with contextlib.suppress(ProcessLookupError):  # it has ended by itself meanwhile
        os.kill(victim, number)
    return f"{number.name} to {'launcher' if victim == launcher else 'process'}"


def is_saving(checkpoints: pathlib.Path) -> bool:
    """Tells whether a step is being written, or its hashes are."""
    with contextlib.suppress(FileNotFoundError):
        for path in checkpoints.iterdir():
            is_step = path.name.isdecimal()
            if "tmp" in path.name or (is_step and not checksums.exist(path)):
                return True
    return False


def newest(checkpoints: pathlib.Path) -> int:
    return max((int(path.stem) for path in checkpoints.glob("*.sha256")), default=0)


@pytest.mark.chaos
def test_thirty_kills_change_nothing(tmp_path: pathlib.Path) -> None:
    chance = random.Random(0)
    (tmp_path / "tiny.yaml").write_text(TINY)
    checkpoints = tmp_path / "disturbed" / "checkpoints"
    launcher, kept, told, in_saves = start(tmp_path, "disturbed"), 0, [], 0
    try:
        while len(told) < KILLS:
            time.sleep(chance.uniform(0, LONGEST_SECONDS))
            until = time.monotonic() + LONGEST_SECONDS * chance.choice([0, 1])
            while time.monotonic() < until and not is_saving(checkpoints):
                time.sleep(POLL_SECONDS)
            if launcher.poll() is None:
                in_saves += is_saving(checkpoints)
                told.append(kill_one(launcher.pid, chance))
                # What was saved when the kill came is there after it.
                assert newest(checkpoints) >= kept, told
                kept = newest(checkpoints)
            else:
                assert launcher.returncode in HARMLESS, told
                launcher = start(tmp_path, "disturbed")
        assert kept < UPDATES, "it has ended before the last kill"
        while (code := launcher.wait()) != 0:
            assert code in HARMLESS, told
            launcher = start(tmp_path, "disturbed")
    finally:
        launcher.kill()
        launcher.wait()
    print(f"{in_saves} of {KILLS} kills in the middle of a save; {told}")

    assert start(tmp_path, "alone").wait() == 0
    found, expected = (
        saved.arrays(tmp_path / out, UPDATES) for out in ("disturbed", "alone")
    )
    assert found.keys() == expected.keys()
    for name, array in found.items():
        np.testing.assert_array_equal(array, expected[name], err_msg=name)
    lines = [logbook.read(tmp_path / out) for out in ("disturbed", "alone")]
    assert [line["loss"] for line in lines[0]] == [line["loss"] for line in lines[1]]
    assert len(lines[0]) == UPDATES // 2
