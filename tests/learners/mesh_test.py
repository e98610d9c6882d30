"""Tests of four devices at work, in a process of its own."""

import numpy as np
import pytest

from tests.learners import many_devices

ROUNDING = 1e-6  # float32 means of a few numbers of order one


@pytest.fixture(name="results", scope="module")
def fixture_results() -> dict:
    return many_devices.run("four_devices", 4)


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
