"""Tests that curves are what runs have logged, each seed's apart."""

import pathlib

import numpy as np
import pytest
from matplotlib import image

from drivetrain.launch import config, curves, logbook
from drivetrain.launch.experiment import Experiment
from drivetrain.launch.runs import CHECKPOINTS, CONFIG
from drivetrain.learners import checksums
from drivetrain.learners.bc import CloningConfig

BATCH = 16


@pytest.fixture
def run_of(tmp_path: pathlib.Path):
    """Makes folders of runs that have logged some lines."""

    def make(name: str, seeds: int, lines: list[dict[str, float]]) -> pathlib.Path:
        folder = tmp_path / name
        (folder / CHECKPOINTS / "4").mkdir(parents=True)
        checksums.write(folder / CHECKPOINTS / "4")
        learner = CloningConfig(batch_size=BATCH)
        experiment = Experiment(data="none", seeds=seeds, learner=learner)
        (folder / CONFIG).write_text(config.to_yaml(experiment), encoding="utf-8")
        with logbook.Logbook(folder) as log:
            for number, line in enumerate(lines):
                log.write(2 * number + 2, line)
        return folder

    return make


def test_each_seed_has_its_values_by_the_steps_that_were_played(run_of) -> None:
    lines = [
        {"loss": 9.0, "seed0/loss": 1.0, "seed1/loss": 3.0},
        {"loss": 9.0},
        {"loss": 9.0, "seed0/loss": 2.0, "seed1/loss": float("nan")},
    ]
    (curve,) = curves.read(run_of("a", 2, lines), ["loss", "return"]).values()
    np.testing.assert_array_equal(curve.steps, [2 * BATCH, 6 * BATCH])
    np.testing.assert_array_equal(curve.values, [[1.0, 2.0], [3.0, np.nan]])


def test_a_lone_seed_has_no_number(run_of) -> None:
    found = curves.read(run_of("a", 1, [{"loss": 4.0}]), ["loss"])
    np.testing.assert_array_equal(found["loss"].values, [[4.0]])


def test_a_run_that_lacks_a_metric_keeps_its_color_elsewhere(run_of, drivetrain):
    run_of("a", 1, [{"x": 1.0}, {"x": 2.0}])
    run_of("b", 1, [{"x": 2.0, "y": 1.0}, {"x": 1.0, "y": 2.0}])
    assert drivetrain("curves", "a", "b", "--metrics", "x, y", "--out", "c.png") == 0
    picture = image.imread("c.png")[..., :3]
    left, right = np.array_split(picture[80:], 2, axis=1)
    blue, red = (_has(color) for color in curves.COLORS[:2])
    assert blue(left) and red(left) and red(right) and not blue(right)


def _has(color: str):
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    # Half a step of an 8-bit channel.
    return lambda picture: np.any(np.all(np.abs(picture - wanted) < 2e-3, axis=-1))


def test_what_nobody_has_logged_is_named(run_of, drivetrain, capsys) -> None:
    run_of("a", 2, [{"seed0/loss": 1.0, "seed1/loss": 1.0}])
    assert drivetrain("curves", "a", "--metrics", "los") == 2
    assert "did you mean 'loss'? Known: loss." in capsys.readouterr().err


def test_runs_of_one_name_are_told_apart(run_of, drivetrain) -> None:
    run_of("x/a", 1, [{"loss": 1.0}])
    run_of("y/a", 1, [{"loss": 2.0}])
    paths = [pathlib.Path("x/a"), pathlib.Path("y/a")]
    panels = curves.read_all(paths, ["loss"])
    assert {name: curve.values.item() for name, curve in panels["loss"].items()} == {
        "x/a": 1.0,
        "y/a": 2.0,
    }


def test_runs_left_out_of_a_panel_are_told(run_of, drivetrain, capsys) -> None:
    run_of("a", 1, [{"loss": 1.0, "kl": 1.0}])
    run_of("b", 1, [{"loss": 2.0}])
    assert drivetrain("curves", "a", "b", "--metrics", "loss,kl", "--out", "c.png") == 0
    told = capsys.readouterr().out.splitlines()
    assert told == ["drawn: c.png", "left out of kl, not logged there: b"]
