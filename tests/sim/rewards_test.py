"""Tests of the weighted reward."""

import jax.numpy as jnp

from drivetrain.sim import rewards
from drivetrain.sim.metrics.base import Measure
from tests import worlds

EGO = jnp.int32(0)


def measure(value: float, valid: bool = True) -> Measure:
    return Measure(value=jnp.float32(value), valid=jnp.array(valid))


def test_the_sparse_reward_counts_collision_and_offroad() -> None:
    reward = rewards.weighted(rewards.SPARSE)
    moment = worlds.samples("generated")[0].moment
    for collision, offroad, expected in ((0, 0, 0), (1, 0, -1), (0, 1, -1), (1, 1, -2)):
        measures = {"collision": measure(collision), "offroad": measure(offroad)}
        assert float(reward(moment, EGO, measures)) == expected


def test_a_measure_that_is_not_valid_counts_as_zero() -> None:
    reward = rewards.weighted({"collision": -1.0})
    measures = {"collision": measure(1.0, valid=False)}
    moment = worlds.samples("generated")[0].moment
    assert float(reward(moment, EGO, measures)) == 0.0
