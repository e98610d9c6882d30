"""Measures how far a policy is from what it should do."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..agents.distributions import Categorical, Distribution, TanhMixture
from ..sim.dynamics.base import Action


def weighted_sum(
    values: Float[Array, " batch"], weights: Float[Array, " batch"]
) -> Float[Array, ""]:
    """Sums values by weight; a value of weight zero may be anything, NaN included."""
    return jnp.sum(jnp.where(weights > 0, values, 0.0) * weights)


def imitation_error(
    distribution: Distribution, action: Action
) -> dict[str, Float[Array, ""]]:
    """Compares the action that a policy would drive with the expert's.

    Returns:
        `accuracy`, whether the two are the same, for numbered actions; else
        `absolute_error`, averaged over the features as fractions of their ranges, since
        their units differ.
    """
    mode = distribution.mode()
    match distribution:
        case Categorical():
            return {"accuracy": (mode == action).astype(jnp.float32)}
        case TanhMixture(bounds=bounds):
            span = jnp.array(bounds.high) - jnp.array(bounds.low)
            return {"absolute_error": jnp.mean(jnp.abs(mode - action) / span)}
