"""Divides a batch into minibatches, the same ones on any number of devices."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key, PyTree

from .strata import Share


def deal(
    share: Share, key: Key[Array, ""], num_units: int, num_minibatches: int
) -> Int[Array, "minibatches strata units"]:
    """Deals the units of each stratum out at random, by that stratum's key.

    Args:
        share: the strata of this device.
        key: of the order.
        num_units: of a stratum; a multiple of the number of minibatches.
        num_minibatches: each of which gets as many of every stratum.

    Returns:
        The numbers of the units of each minibatch; each unit is in one of them.
    """
    permute = jax.vmap(jax.random.permutation, in_axes=(0, None))
    order = permute(share.keys(key), num_units)
    parts = order.reshape(len(order), num_minibatches, -1)
    return jnp.moveaxis(parts, 1, 0)


def take(batch: PyTree[Array], units: Int[Array, "strata units"]) -> PyTree[Array]:
    """Returns the units of a minibatch from arrays `[strata, units, ...]`."""

    def of_leaf(leaf: Array) -> Array:
        return jax.vmap(lambda own, numbers: own[numbers])(leaf, units)

    return jax.tree.map(of_leaf, batch)
