"""Tests of four devices at work, in a process of its own."""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
ROUNDING = 1e-6  # float32 means of a few numbers of order one


@pytest.fixture(name="results", scope="module")
def fixture_results() -> dict:
    flags = "--xla_force_host_platform_device_count=4"
    finished = subprocess.run(
        [sys.executable, "-m", "tests.learners.four_devices"],
        cwd=ROOT,
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)


def test_the_replicas_stay_equal(results: dict) -> None:
    for name in ("own", "any"):
        first, *others = results[name]["params"]
        assert len(others) == 3 and all(other == first for other in others)


def test_the_gradient_is_the_weighted_mean_over_all_devices(results: dict) -> None:
    params = np.array(results["own"]["params"][0])
    # From equal logits: minus the mean of softmax - onehot, the weights 0, 1, 2, 5.
    expected = np.full(len(params), -1 / len(params))
    expected[:4] += np.array([0, 1, 2, 5]) / 8
    np.testing.assert_allclose(params, expected, atol=ROUNDING)
    assert abs(results["own"]["loss"] - np.log(len(params))) < 10 * ROUNDING


def test_devices_draw_different_samples(results: dict) -> None:
    params = np.array(results["any"]["params"][0])
    assert (params > 0).sum() > 1
