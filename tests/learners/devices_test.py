"""Tests that the number of devices changes nothing but the order of sums."""

import functools

import numpy as np
import pytest

from tests.learners import many_devices
from tests.learners.every import LEARNERS

# Sums over devices in another order. Adam's first steps are signs of gradients: where
# one is near zero, rounding decides a small part of a step of 0.001 (bc) or 0.03.
REORDERED = 1e-4


@functools.cache
def results() -> dict:
    return many_devices.run("eight_devices", 8)


@pytest.mark.parametrize("name", ["bc of logs", *LEARNERS])
def test_several_devices_learn_what_one_does(name: str) -> None:
    one, several = results()[name]
    np.testing.assert_allclose(one["params"], several["params"], atol=REORDERED)
    assert one["metrics"].keys() == several["metrics"].keys()
    for metric, means in one["metrics"].items():
        np.testing.assert_allclose(
            means, several["metrics"][metric], rtol=REORDERED, atol=REORDERED
        )
