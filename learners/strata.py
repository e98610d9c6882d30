"""Shares a batch and its worlds among devices so that their number changes nothing.

All is divided into strata, each with scenarios and random keys of its own; a device
works on some of them. The same strata on one device or on eight give the same numbers,
up to the order of sums.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key, PyTree

from ..sim.data import dealing
from ..sim.data.stratum import Stratum
from ..sim.env.base import State
from ..sim.records import Record


class Share(Record):
    """The strata of one device."""

    number: Int[Array, " strata"]  # among those of all devices
    stratum: Stratum  # of each, the scenarios

    def keys(self, key: Key[Array, ""]) -> Key[Array, " strata"]:
        """Returns a key of each stratum."""
        return jax.vmap(jax.random.fold_in, in_axes=(None, 0))(key, self.number)


def share(num_strata: int, axis_name: str) -> Share:
    """Returns the strata of this device, so many in a row.

    Raises:
        ValueError: while it is traced, if the devices do not divide the strata.
    """
    per_device = dealing.strata_of_each(num_strata, jax.lax.axis_size(axis_name))
    first = jnp.arange(per_device)
    return Share(
        number=jax.lax.axis_index(axis_name) * per_device + first,
        stratum=Stratum(first=first, stride=per_device),
    )


def own(tree: PyTree[Array], axis_name: str) -> PyTree[Array]:
    """Marks arrays that are the same on all devices as each device's own."""
    return jax.tree.map(lambda leaf: jax.lax.pcast(leaf, axis_name, to="varying"), tree)


def merge(tree: PyTree[Array]) -> PyTree[Array]:
    """Makes one leading axis of two, such as strata and what each has."""
    return jax.tree.map(
        lambda leaf: leaf.reshape(leaf.shape[0] * leaf.shape[1], *leaf.shape[2:]), tree
    )


def part(tree: PyTree[Array], num_strata: int) -> PyTree[Array]:
    """Makes two leading axes of one: strata, and what each has."""
    return jax.tree.map(
        lambda leaf: leaf.reshape(
            num_strata, leaf.shape[0] // num_strata, *leaf.shape[1:]
        ),
        tree,
    )


def redeal(
    worlds: PyTree[Array], num_before: int, num_now: int, axis: int = 0
) -> PyTree[Array]:
    """Tells worlds where their scenarios lie once other devices share the strata.

    On a device with k of the strata, number j among them has the scenarios j, j + k,
    and so on (`dealing.by_stratum`).

    Args:
        worlds: a tree with the states of worlds, of the strata of all devices.
        num_before: devices that shared the strata; it divides their number.
        num_now: devices that share them now, likewise.
        axis: of the strata.
    """

    def move(tree: PyTree[Array]) -> PyTree[Array]:
        if not isinstance(tree, State):
            return tree
        num_strata = tree.index.shape[axis]
        before, now = (
            dealing.strata_of_each(num_strata, count) for count in (num_before, num_now)
        )
        stratum = jnp.arange(num_strata).reshape(
            [-1 if i == axis else 1 for i in range(tree.index.ndim)]
        )
        place = tree.index // before  # in the stratum
        return tree.replace(index=place * now + stratum % now)

    return jax.tree.map(move, worlds, is_leaf=lambda tree: isinstance(tree, State))


def check(num_strata: int, **parts: int) -> None:
    """Checks that strata divide what a config counts.

    Args:
        num_strata: how many there are.
        **parts: counts over all devices, by the name of their field.

    Raises:
        ValueError: if there is no stratum, or one would get a fraction or nothing.
    """
    if num_strata < 1:
        raise ValueError(f"strata must be at least 1, got {num_strata}.")
    for name, count in parts.items():
        if count < 1 or count % num_strata:
            raise ValueError(
                f"{name} must be a positive multiple of strata, got {count} for "
                f"{num_strata} strata."
            )
