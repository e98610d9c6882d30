"""Tests that the number of devices changes nothing but the order of sums."""

import functools
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Sums over devices in another order. Adam's first steps are signs of gradients: where
# one is near zero, rounding decides a small part of a step of 0.001 (bc) or 0.03.
REORDERED = 1e-4


@functools.cache
def results() -> dict:
    flags = "--xla_force_host_platform_device_count=8"
    finished = subprocess.run(
        [sys.executable, "-m", "tests.learners.eight_devices"],
        cwd=ROOT,
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return json.loads(finished.stdout)


@pytest.mark.parametrize("name", ["bc", "dqn", "ppo"])
def test_several_devices_learn_what_one_does(name: str) -> None:
    one, several = results()[name]
    np.testing.assert_allclose(one["params"], several["params"], atol=REORDERED)
    assert one["metrics"].keys() == several["metrics"].keys()
    for metric, means in one["metrics"].items():
        np.testing.assert_allclose(
            means, several["metrics"][metric], rtol=REORDERED, atol=REORDERED
        )
