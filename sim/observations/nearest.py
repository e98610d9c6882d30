"""Chooses the nearest of many things, as many as fit."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


def nearest(
    distance: Float[Array, " things"], valid: Bool[Array, " things"], count: int
) -> tuple[Int[Array, " chosen"], Bool[Array, " chosen"]]:
    """Returns the numbers of the nearest valid things, nearest first, and their mask.

    Args:
        distance: of each thing; any unit.
        valid: which things are there.
        count: how many to choose; where fewer things are valid, the mask is False.
    """
    padding = max(count - len(distance), 0)
    far = jnp.pad(
        jnp.where(valid, distance, jnp.inf), (0, padding), constant_values=jnp.inf
    )
    negated, number = jax.lax.top_k(-far, count)
    present = jnp.isfinite(negated)
    return jnp.where(present, number, 0), present
