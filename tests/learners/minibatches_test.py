"""Tests that minibatches share a batch out, whatever the number of devices."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.learners import minibatches
from drivetrain.learners.strata import Share
from drivetrain.sim.data.stratum import Stratum

NUM_STRATA, NUM_UNITS, NUM_MINIBATCHES = 8, 12, 3


def share(numbers: list[int]) -> Share:
    """Makes the share of a device that works on some strata."""
    here = jnp.array(numbers)
    return Share(number=here, stratum=Stratum(first=here, stride=NUM_STRATA))


def deal(numbers: list[int], seed: int = 0) -> np.ndarray:
    key = jax.random.key(seed)
    return np.asarray(minibatches.deal(share(numbers), key, NUM_UNITS, NUM_MINIBATCHES))


def test_each_unit_is_in_one_minibatch() -> None:
    dealt = deal(list(range(NUM_STRATA)))
    assert dealt.shape == (NUM_MINIBATCHES, NUM_STRATA, NUM_UNITS // NUM_MINIBATCHES)
    for stratum in range(NUM_STRATA):
        units = np.sort(dealt[:, stratum].reshape(-1))
        np.testing.assert_array_equal(units, np.arange(NUM_UNITS))


def test_a_stratum_is_dealt_alike_wherever_it_is() -> None:
    everywhere = deal(list(range(NUM_STRATA)))
    for device in range(4):
        own = [device, device + 4]
        np.testing.assert_array_equal(deal(own), everywhere[:, own])


def test_strata_and_keys_are_dealt_differently() -> None:
    dealt = deal([0, 1])
    assert (dealt[:, 0] != dealt[:, 1]).any()
    assert (dealt != deal([0, 1], seed=1)).any()


def test_units_are_taken_from_their_own_stratum() -> None:
    strata, units = jnp.meshgrid(jnp.arange(2), jnp.arange(5), indexing="ij")
    batch = {"name": jnp.stack([strata, units], axis=-1)}
    taken = minibatches.take(batch, jnp.array([[4, 0], [2, 2]]))
    np.testing.assert_array_equal(taken["name"], [[[0, 4], [0, 0]], [[1, 2], [1, 2]]])
