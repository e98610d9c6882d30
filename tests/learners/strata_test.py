"""Tests that worlds find their scenarios again when other devices share them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import strata
from drivetrain.sim import pytrees
from drivetrain.sim.data import dealing
from tests.learners import probes

NUM_STRATA = 24
PER_STRATUM = 3  # worlds


def played(index: np.ndarray, dealt: list[list[int]], axis: int) -> np.ndarray:
    """Returns the numbers, among all scenarios, of those that worlds play."""
    per_device = NUM_STRATA // len(dealt)
    rows = np.moveaxis(index, axis, 0)
    found = [
        [dealt[stratum // per_device][place] for place in row.ravel()]
        for stratum, row in enumerate(rows)
    ]
    return np.array(found)


@pytest.mark.parametrize("num_scenarios", [5, 24, 100])
@pytest.mark.parametrize(("num_before", "num_now"), [(8, 1), (8, 3), (1, 4), (2, 12)])
@pytest.mark.parametrize("axis", [0, 1])
def test_worlds_play_the_same_scenarios_on_other_devices(
    num_scenarios: int, num_before: int, num_now: int, axis: int
) -> None:
    before, now = (
        dealing.by_stratum(num_scenarios, count, NUM_STRATA)
        for count in (num_before, num_now)
    )
    per_device = NUM_STRATA // num_before
    rng = np.random.default_rng(0)
    index = np.empty((NUM_STRATA, PER_STRATUM), np.int32)
    for stratum in range(NUM_STRATA):
        own = range(
            stratum % per_device, len(before[stratum // per_device]), per_device
        )
        index[stratum] = rng.choice(own, PER_STRATUM)
    if axis:  # of two seeds
        index = np.stack([index, index])
    state = pytrees.spread(probes.state(1, -1.0), *index.shape)
    state = state.replace(index=jnp.array(index))

    moved = strata.redeal({"a": state}, num_before, num_now, axis)["a"]

    np.testing.assert_array_equal(
        played(np.asarray(moved.index), now, axis), played(index, before, axis)
    )
    same = jax.tree.map(lambda a, b: bool((a == b).all()), moved, state)
    assert all(jax.tree.leaves(same.replace(index=True)))
