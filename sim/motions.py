"""Takes the motions of a scenario's objects apart, and puts them together."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from . import pytrees
from .motion import Motion


def object_of(motion: Motion, number: int) -> Motion:
    """Returns the motion of one object, without the axis of objects."""
    return jax.tree.map(lambda leaf: leaf[number], motion)


def where(mask: Bool[Array, " objects"], chosen: Motion, other: Motion) -> Motion:
    """Chooses between two motions, object by object."""
    return pytrees.where(mask, chosen, other)


def only(mask: Bool[Array, " objects"], motion: Motion) -> Motion:
    """Returns the motion with nobody there but the objects of the mask."""
    return where(mask, motion, jax.tree.map(jnp.zeros_like, motion))


def on_the_ground(moved: Motion, before: Motion, logged: Motion) -> Motion:
    """Takes heights from the log, and keeps the last ones where it has none."""
    height = jnp.where(logged.valid, logged.xyz[:, 2], before.xyz[:, 2])
    height = jnp.where(moved.valid, height, 0.0)
    return moved.replace(xyz=moved.xyz.at[:, 2].set(height))


def append(history: Motion, motion: Motion) -> Motion:
    """Appends the present step to the steps before it."""
    return jax.tree.map(
        lambda past, now: jnp.concatenate([past, now[None]]), history, motion
    )
