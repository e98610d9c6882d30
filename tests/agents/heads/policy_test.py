"""Tests that a head's distribution stays one whatever its features are."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.distributions import TanhMixture
from drivetrain.agents.heads.policy import MIN_SCALE, TanhMixtureHead
from drivetrain.sim.dynamics.base import Continuous

SPEC = Continuous(low=(-6.0, -0.3), high=(6.0, 0.3))
NUM_DRAWS = 1000
# Of 2,000 normal draws one in 500 such tests is beyond 5.5 deviations; 1 for float32.
FAR = 6.5


def policy(size: float) -> TanhMixture:
    """Returns the distribution at features of some size."""
    head = TanhMixtureHead(8, SPEC, 1, rngs=nnx.Rngs(0))
    # As after training: kernels begin small.
    head.mean.kernel[...] = jax.random.normal(jax.random.key(1), (8, 2))
    head.raw_scale.kernel[...] = -jnp.ones((8, 2))
    return head(size * jnp.ones(8))


@pytest.mark.parametrize("size", [0.1, 1.0, 1e3, 1e6])
def test_what_it_draws_is_never_far_from_it(size: float) -> None:
    found = policy(size)
    draws = jax.vmap(found.sample)(jax.random.split(jax.random.key(0), NUM_DRAWS))
    told = np.asarray(jax.vmap(found.log_prob)(draws), np.float64)
    # The density of an action FAR deviations from the mean in each feature, before
    # squashing; what squashing adds is at least -log of half a range.
    scale = np.asarray(found.scale, np.float64)
    least = np.sum(-0.5 * FAR**2 - np.log(scale) - 0.5 * math.log(2 * math.pi))
    assert told.min() > least - math.log(6.0) - math.log(0.3)


def test_scales_have_a_floor() -> None:
    np.testing.assert_allclose(policy(1e3).scale, MIN_SCALE, rtol=1e-6)
