"""Turns measures into a reward."""

from collections.abc import Callable, Mapping

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .metrics.base import Measure, Moment

# Of a moment, an object's number and its measures.
Reward = Callable[[Moment, Int[Array, ""], dict[str, Measure]], Float[Array, ""]]

# W 5.2: r = -1[collision] - 1[off-road].
SPARSE = {"collision": -1.0, "offroad": -1.0}


def weighted(weights: Mapping[str, float]) -> Reward:
    """Builds the weighted sum of metrics of the state after the action.

    Args:
        weights: of metrics by name; a measure that is not valid counts as zero.
    """

    def reward(
        moment: Moment, number: Int[Array, ""], measures: dict[str, Measure]
    ) -> Float[Array, ""]:
        del moment, number
        parts = [
            weight * jnp.where(measures[name].valid, measures[name].value, 0.0)
            for name, weight in weights.items()
        ]
        return jnp.sum(jnp.stack(parts))

    return reward
