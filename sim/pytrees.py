"""Chooses between trees of arrays, and copies them."""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

Tree = TypeVar("Tree")


def where(mask: Bool[Array, "*batch"], chosen: Tree, other: Tree) -> Tree:
    """Returns one tree where the mask is True, and the other elsewhere.

    Args:
        mask: along the leading axes of every array.
        chosen: where it is True.
        other: of the same structure.
    """

    def choose(one: Array, two: Array) -> Array:
        rows = mask.reshape(*mask.shape, *[1] * (one.ndim - mask.ndim))
        return jnp.where(rows, one, two)

    return jax.tree.map(choose, chosen, other)


def spread(tree: Tree, *shape: int) -> Tree:
    """Returns the same arrays many times over, along new leading axes."""
    return jax.tree.map(
        lambda leaf: jnp.broadcast_to(leaf, (*shape, *leaf.shape)), tree
    )
