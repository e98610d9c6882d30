"""Tests of the trajectory head: what it may depend on, and how it starts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.heads.trajectory import (
    MIN_SCALE,
    TrajectoryConfig,
    TrajectoryHead,
)
from drivetrain.agents.trajectories import Trajectories

WIDTH, TOKENS = 8, 6
CONFIG = TrajectoryConfig(num_modes=3, num_steps=5, num_layers=1, num_heads=2)
ROUNDING = 1e-5  # float32 sums over the tokens, in another order
MASK = jnp.array([1, 0, 1, 1, 0, 1], bool)
HEAD = nnx.split(TrajectoryHead(WIDTH, CONFIG, rngs=nnx.Rngs(0)))


@jax.jit
def forecast(tokens: jax.Array, mask: jax.Array) -> Trajectories:
    return nnx.merge(*HEAD)(tokens, mask)


def tokens(seed: int = 1) -> jax.Array:
    return jax.random.normal(jax.random.key(seed), (TOKENS, WIDTH))


def test_every_mode_has_a_logit_and_its_steps() -> None:
    found = forecast(tokens(), MASK)
    assert found.logits.shape == (3,)
    assert found.mean.shape == found.scale.shape == (3, 5, 3)
    assert (found.scale > MIN_SCALE).all()


def test_modes_start_apart_and_near_standing_still() -> None:
    found = forecast(tokens(), MASK)
    assert (jnp.ptp(found.mean, axis=0) > 0).all()
    assert jnp.abs(found.mean).max() < 2  # metres, of steps of about 0.1 each


def test_absent_tokens_never_matter() -> None:
    changed = jnp.where(MASK[:, None], tokens(), 7.0)
    jax.tree.map(
        np.testing.assert_array_equal, forecast(tokens(), MASK), forecast(changed, MASK)
    )


def test_present_tokens_matter_and_their_order_does_not() -> None:
    found = forecast(tokens(), MASK)
    flipped = forecast(tokens()[::-1], MASK[::-1])
    np.testing.assert_allclose(flipped.mean, found.mean, atol=ROUNDING)
    other = forecast(tokens(2), MASK)
    assert jnp.abs(other.mean - found.mean).max() > 100 * ROUNDING


def test_without_any_token_forecast_and_gradient_are_finite() -> None:
    graphdef, state = HEAD

    @jax.jit
    @jax.grad
    def gradient(state):
        found = nnx.merge(graphdef, state)(tokens(), jnp.zeros(TOKENS, bool))
        density = found.step_log_prob(jnp.ones((5, 3)))
        return density.sum() + jax.nn.log_softmax(found.logits)[0]

    leaves = jax.tree.leaves(
        (forecast(tokens(), jnp.zeros_like(MASK)), gradient(state))
    )
    assert all(jnp.isfinite(leaf).all() for leaf in leaves)


def test_the_mean_is_the_sum_of_the_steps() -> None:
    head = nnx.merge(*HEAD)
    head.step.kernel[...] = jnp.zeros_like(head.step.kernel[...])
    head.step.bias[...] = jnp.tile(jnp.array([1.0, 0.5, 0.1]), 5)
    expected = np.arange(1, 6)[:, None] * np.array([[1.0, 0.5, 0.1]])
    found = jax.jit(head)(tokens(), MASK)
    np.testing.assert_allclose(
        found.mean, np.broadcast_to(expected, (3, 5, 3)), atol=ROUNDING
    )


def test_impossible_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="num_modes must be at least 1, got 0"):
        TrajectoryConfig(num_modes=0)
    with pytest.raises(ValueError, match="num_heads must divide width, got 4 heads"):
        TrajectoryHead(6, TrajectoryConfig(), rngs=nnx.Rngs(0))
