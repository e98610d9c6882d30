"""Shares a batch and its worlds among devices so that their number changes nothing.

All is divided into strata, each with scenarios and random keys of its own; a device
works on some of them. The same strata on one device or on eight give the same numbers,
up to the order of sums.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key, PyTree

from ..sim.data.stratum import Stratum
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
    num_devices = jax.lax.axis_size(axis_name)
    if num_strata % num_devices:
        raise ValueError(
            f"strata must be a multiple of the number of devices, got {num_strata} for "
            f"{num_devices}; set learner.strata."
        )
    per_device = num_strata // num_devices
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
