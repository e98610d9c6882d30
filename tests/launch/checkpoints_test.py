"""Tests that the checkpoints of a run are listed and checked."""

import pathlib
import shutil

import jax.numpy as jnp
import pytest

from drivetrain.learners.checkpoint import Checkpoints
from tests.launch.cli_test import TINY

BEST_BY = "monitor: {data: synthetic:0:2, every: 4, best_by: goal_pct}"


@pytest.fixture
def run(tmp_path: pathlib.Path) -> pathlib.Path:
    """A run with two checkpoints, a cut one and one that was found damaged."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "config.yaml").write_text(TINY + BEST_BY)
    checkpoints = Checkpoints(folder / "checkpoints")
    for step, goals in ((2_000, 50.0), (4_000, 40.0)):
        known = {
            "layout": {"devices": 8},
            "evaluation": {"evaluation/goal_pct": goals},
            "versions": {"jax": "0.9.9", "Python": "3.12.1"},
        }
        checkpoints.save(step, {"a": jnp.arange(3)}, known)
    (folder / "checkpoints" / "6000").mkdir()
    (folder / "checkpoints" / "1000.damaged").mkdir()
    return folder


def test_they_are_listed_in_order_with_their_state(drivetrain, run, capsys) -> None:
    assert drivetrain("checkpoint", "list", "run") == 0
    told = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")] for line in told.splitlines()]
    assert [(row[1], row[3], row[5], row[6]) for row in rows if row[1:]] == [
        ("1,000", "-", "damaged", "-"),
        ("2,000", "8", "finished, best", "50.00"),
        ("4,000", "8", "finished", "40.00"),
        ("6,000", "-", "not finished", "-"),
    ]
    assert told.count("saved with jax 0.9.9, Python 3.12.1") == 1


def test_those_that_are_damaged_are_named(drivetrain, run, capsys) -> None:
    assert drivetrain("checkpoint", "verify", "run") == 2
    told = capsys.readouterr()
    assert "4,000: as it was saved" in told.out
    assert "6,000: its hashes cannot be read" in told.out
    (run / "checkpoints" / "6000").rmdir()
    assert drivetrain("checkpoint", "verify", "run") == 0
    capsys.readouterr()
    with (run / "checkpoints" / "4000" / "commit_success.txt").open("a") as file:
        file.write("x")
    assert drivetrain("checkpoint", "verify", "run") == 2
    told = capsys.readouterr()
    assert "2,000: as it was saved" in told.out
    assert "4,000: the hash of 4000/commit_success.txt differs" in told.out
    assert "1 of the 2 checkpoints of 'run' are damaged: 4,000" in told.err


def test_a_run_without_checkpoints_is_told(drivetrain, run, capsys) -> None:
    shutil.rmtree(run / "checkpoints")
    for word in ("list", "verify"):
        assert drivetrain("checkpoint", word, "run") == 2
        assert "'run' has no checkpoint yet" in capsys.readouterr().err


def test_a_folder_that_is_no_run_is_refused(drivetrain, run, capsys) -> None:
    assert drivetrain("checkpoint", "list", "run/checkpoints") == 2
    assert "is no run: config.yaml is missing" in capsys.readouterr().err
