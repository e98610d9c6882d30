"""Keeps some past parameters of an agent, for it to meet its past selves."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key

from ..agents.base import Params
from ..sim import pytrees
from ..sim.records import Record


class Pasts(Record):
    """A ring of past parameters, with a leading axis; the newest replace the oldest."""

    params: Params
    count: Int[Array, ""]  # how many were ever put in


def begin(params: Params, size: int) -> Pasts:
    """Returns the ring that holds the first parameters alone."""
    return Pasts(params=pytrees.spread(params, size), count=jnp.int32(1))


def keep(pasts: Pasts, params: Params, wanted: Array) -> Pasts:
    """Puts parameters into the ring, if they are wanted."""

    def put(ring: Array, leaf: Array) -> Array:
        slot = pasts.count % len(ring)
        return jnp.where(wanted, ring.at[slot].set(leaf), ring)

    return Pasts(
        params=jax.tree.map(put, pasts.params, params), count=pasts.count + wanted
    )


def draw(pasts: Pasts, key: Key[Array, ""]) -> Int[Array, ""]:
    """Draws the place of one of those in the ring, each as likely."""
    size = len(jax.tree.leaves(pasts.params)[0])
    return jax.random.randint(key, (), 0, jnp.minimum(pasts.count, size))


def at(pasts: Pasts, place: Int[Array, ""]) -> Params:
    """Returns those at a place of the ring."""
    return jax.tree.map(lambda ring: ring[place], pasts.params)
