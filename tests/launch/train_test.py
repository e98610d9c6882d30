"""Tests of training as a user starts it: seeds, parts of other runs, divergence."""

import json
import pathlib

import numpy as np
import pytest

from drivetrain.launch import config, logbook
from drivetrain.launch.experiment import Experiment
from drivetrain.launch.train import train
from tests.launch import saved
from tests.launch.cli_test import TINY

ROUNDING = 1e-5  # relative, of float32 means


def params_of(run: pathlib.Path, step: int) -> dict[str, np.ndarray]:
    """Returns the parameters in a checkpoint of a run."""
    found = saved.arrays(run, step)
    return {n: leaf for n, leaf in found.items() if n.startswith(".params")}


def test_seeds_are_trained_together_and_evaluated_each(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    watched = "monitor={data: synthetic:0:2, every: 2, best_by: log_ade_m}"
    # At a rate that goes up and down, so that the newest is not the best.
    kept = ("keep_newest=1", "updates=8", "learner.learning_rate=0.3")
    words = ("train", "tiny.yaml", "seeds=2", watched, *kept, "--out", "two")
    assert drivetrain(*words) == 0
    *_, last = logbook.read(tmp_path / "two")
    both = [last["seed0/loss"], last["seed1/loss"]]
    assert both[0] != both[1]
    np.testing.assert_allclose(last["loss"], np.mean(both), rtol=ROUNDING)
    assert last["seed1/evaluation/log_ade_m"] > 0

    few = ("--data", "synthetic:0:2", "--max-objects", "12")
    assert drivetrain("evaluate", "two", *few, "--json", "two.json") == 0
    rows = json.loads((tmp_path / "two.json").read_text())
    assert [row.get("seeds") for row in rows] == [None, None, 2]
    mean = np.mean([row["log_ade_m"] for row in rows[:2]])
    np.testing.assert_allclose(rows[2]["log_ade_m"], mean, rtol=ROUNDING)
    # What training saw of a seed is what evaluation finds.
    assert last["seed1/evaluation/log_ade_m"] == pytest.approx(rows[1]["log_ade_m"])
    capsys.readouterr()
    assert drivetrain("evaluate", "two", *few, "--dump", "d") == 2
    assert "choose one with --run-seed" in capsys.readouterr().err
    assert drivetrain("evaluate", "two", *few, "--run-seed", "2") == 2
    assert "has the seeds 0 to 1, got 2" in capsys.readouterr().err

    figures = {
        line["step"]: line["evaluation/log_ade_m"]
        for line in logbook.read(tmp_path / "two")
    }
    best = min(figures, key=figures.__getitem__)
    there = {path.stem for path in (tmp_path / "two/checkpoints").glob("*.sha256")}
    assert best != 8 and there == {str(best), "8"}
    words = ("evaluate", "two", *few, "--json", "best.json", "--checkpoint")
    assert drivetrain(*words, "best") == 0
    rows = json.loads((tmp_path / "best.json").read_text())
    assert [row.get("update") for row in rows] == [best, best, None]
    assert rows[2]["log_ade_m"] == pytest.approx(figures[best])
    capsys.readouterr()
    assert drivetrain(*words, "5") == 2
    assert f"no checkpoint of update 5; it has {best}, 8" in capsys.readouterr().err
    assert drivetrain(*words, "bset") == 2
    assert "newest, best or the number of an update" in capsys.readouterr().err


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """The folder of a run of two seeds."""
    folder = tmp_path_factory.mktemp("two")
    (folder / "tiny.yaml").write_text(TINY)
    run = config.load(folder / "tiny.yaml", Experiment, ("seeds=2",))
    train(run, folder / "run")
    return folder / "run"


# Seed i begins with seed i of the other run, counted round; the first is then number 5.
@pytest.mark.parametrize(("seeds", "expected"), [(1, 0), (3, [0, 1, 0])])
def test_frozen_parts_of_another_run_stay_as_they_were(
    drivetrain, tmp_path: pathlib.Path, two: pathlib.Path, seeds: int, expected
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    words = ("seed=5", f"seeds={seeds}", f"pretrained={two}", "updates=2")
    frozen = "learner.part_rates={encoder: 0, head: 0.5}"
    assert drivetrain("train", "tiny.yaml", *words, frozen, "--out", "second") == 0
    first, second = params_of(two, 4), params_of(tmp_path / "second", 2)
    same = {
        name: np.array_equal(first[name][expected], second[name])
        for name in first
        if first[name].size > 2
    }
    assert all(is_same for name, is_same in same.items() if "'encoder'" in name)
    assert not any(
        is_same
        for name, is_same in same.items()
        if "kernel" in name and "'encoder'" not in name
    )


def test_a_part_that_is_not_there_has_no_rate(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    assert drivetrain("train", "tiny.yaml", "learner.part_rates={encodr: 0}") == 2
    assert "did you mean 'encoder'" in capsys.readouterr().err


def test_a_run_that_diverges_says_where_and_keeps_what_was_good(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    steep = ("learner.learning_rate=1e30", "updates=6")
    assert drivetrain("train", "tiny.yaml", *steep, "--out", "steep") == 2
    error = capsys.readouterr().err
    assert "diverged at update 2" in error and "encoder" in error
    assert "there is no checkpoint before it" in error
    checkpoints = tmp_path / "steep" / "checkpoints"
    assert not checkpoints.exists() or not list(checkpoints.iterdir())
