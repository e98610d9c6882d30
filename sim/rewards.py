"""Turns measures into a reward."""

from collections.abc import Callable, Mapping

import jax.numpy as jnp
from jaxtyping import Array, Float

from .metrics.base import Measure

Reward = Callable[[dict[str, Measure]], Float[Array, ""]]

# W 5.2: r = -1[collision] - 1[off-road].
SPARSE = {"collision": -1.0, "offroad": -1.0}


def weighted(weights: Mapping[str, float]) -> Reward:
    """Builds the weighted sum of metrics of the state after the action.

    Args:
        weights: of metrics by name; a measure that is not valid counts as zero.
    """

    def reward(measures: dict[str, Measure]) -> Float[Array, ""]:
        parts = [
            weight * jnp.where(measures[name].valid, measures[name].value, 0.0)
            for name, weight in weights.items()
        ]
        return jnp.sum(jnp.stack(parts))

    return reward
