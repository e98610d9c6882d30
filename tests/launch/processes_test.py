"""Tests that several processes train as one does, and that one can go on for them."""

import pathlib
import shutil

import numpy as np
import pytest

from drivetrain.launch import logbook
from tests.launch import saved
from tests.launch.cli_test import TINY

# Sums over devices in another order.
ROUNDING = 1e-6
# Beside TINY: scenarios that strata do not divide, and a network that compiles soon.
FLAT = (
    "data=synthetic:0:10",
    "agent={encoder: {name: flat, widths: [16], activation: relu, scale: 1.0}}",
    "learner.batch_size=16",
    "updates=8",
    "updates_per_checkpoint=4",
)
TOGETHER = ("--processes", "2", "--devices-per-process", "2")


def assert_close(found: pathlib.Path, expected: pathlib.Path) -> None:
    a, b = saved.arrays(found, 8), saved.arrays(expected, 8)
    assert a.keys() == b.keys()
    for name in (name for name in a if name.startswith(".params")):
        np.testing.assert_allclose(a[name], b[name], atol=ROUNDING)
    losses = [[line["loss"] for line in logbook.read(run)] for run in (found, expected)]
    np.testing.assert_allclose(*losses, rtol=ROUNDING)


def test_two_processes_train_as_one_and_one_goes_on_for_them(
    drivetrain, tmp_path: pathlib.Path, capfd: pytest.CaptureFixture
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    words = ("train", "tiny.yaml", *FLAT, "--out")
    assert drivetrain(*words, "alone") == 0
    assert drivetrain(*words, "both", *TOGETHER) == 0
    assert "10 scenarios on 4 device(s)" in capfd.readouterr().err
    assert_close(tmp_path / "both", tmp_path / "alone")

    shutil.rmtree(tmp_path / "both" / "checkpoints" / "8")
    assert drivetrain(*words, "both") == 0
    error = capfd.readouterr().err
    assert "continuing both at update 4" in error
    assert "dealt anew (devices 1, before 4): worlds go on" in error
    assert_close(tmp_path / "both", tmp_path / "alone")
