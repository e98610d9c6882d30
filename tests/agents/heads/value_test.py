"""Tests of the heads of values."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from drivetrain.agents.heads.action_values import ActionValueHead, DuelingHead
from drivetrain.agents.heads.value import ValueHead
from drivetrain.sim.dynamics.base import Discrete

FEATURES = jax.random.normal(jax.random.key(0), (16,))
ROUNDING = 1e-6  # float32, sums of 16 terms below one


def test_the_value_is_one_number_and_small_at_first() -> None:
    value = ValueHead(16, rngs=nnx.Rngs(0))(FEATURES)
    assert value.shape == ()
    # Weights of variance 0.01 / 16 give a value of standard deviation near 0.1.
    assert 0 < abs(value) < 0.5


def test_action_values_are_linear_in_the_features() -> None:
    head = ActionValueHead(16, (3,), rngs=nnx.Rngs(0))
    values = head(FEATURES)
    assert values.shape == (3,)
    expected = np.asarray(FEATURES) @ np.asarray(head.values.kernel[...])
    np.testing.assert_allclose(values, expected, atol=ROUNDING)


def test_dueling_values_by_hand() -> None:
    head = DuelingHead(1, (3,), rngs=nnx.Rngs(0))
    head.value.kernel[...] = jnp.array([[5.0]])
    head.advantages.kernel[...] = jnp.array([[1.0, 3.0, 8.0]])
    # V = 5; A = (1, 3, 8) with mean 4.
    np.testing.assert_allclose(head(jnp.ones(1)), [2.0, 4.0, 9.0], atol=ROUNDING)


def test_the_mean_of_dueling_values_is_the_value_of_the_state() -> None:
    head = DuelingHead(16, (5,), rngs=nnx.Rngs(0))
    np.testing.assert_allclose(
        head(FEATURES).mean(), head.value(FEATURES)[0], atol=ROUNDING
    )


def test_values_of_factored_actions_are_sums_by_hand() -> None:
    bins = (2, 3)
    outputs = jnp.array([[1.0, 2.0, 10.0, 30.0, 80.0]])
    # Of actions (0, 0), (0, 1), (0, 2), (1, 0), ... as discrete dynamics number them.
    sums = np.array([11.0, 31.0, 81.0, 12.0, 32.0, 82.0])
    head = ActionValueHead(1, bins, rngs=nnx.Rngs(0))
    head.values.kernel[...] = outputs
    np.testing.assert_allclose(head(jnp.ones(1)), sums, atol=ROUNDING)
    dueling = DuelingHead(1, bins, rngs=nnx.Rngs(0))
    dueling.value.kernel[...] = jnp.array([[5.0]])
    dueling.advantages.kernel[...] = outputs
    expected = 5 + sums - sums.mean()
    np.testing.assert_allclose(dueling(jnp.ones(1)), expected, rtol=ROUNDING)
    first, second = np.unravel_index(np.arange(6), Discrete(6, bins).bins)
    np.testing.assert_array_equal(sums, outputs[0, :2][first] + outputs[0, 2:][second])
