"""Weighs actions by how rare they are among what is shown."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..sim.records import Record


class Frequencies(Record):
    """How much of each numbered action was shown so far."""

    weight: Float[Array, " actions"]


def begin(num_actions: int) -> Frequencies:
    """Returns those of nothing shown, which count each action as shown once."""
    return Frequencies(weight=jnp.ones(num_actions))


def see(
    frequencies: Frequencies,
    actions: Int[Array, " batch"],
    weights: Float[Array, " batch"],
    axis_name: str,
) -> Frequencies:
    """Adds what was shown on all devices."""
    shown = jnp.zeros_like(frequencies.weight).at[actions].add(weights)
    return frequencies.replace(
        weight=frequencies.weight + jax.lax.psum(shown, axis_name)
    )


def weights(
    frequencies: Frequencies, actions: Int[Array, " batch"], exponent: float
) -> Float[Array, " batch"]:
    """Returns the weights of actions, (1 / (N f_a))^c for N actions of frequencies f.

    With c = 1 each action weighs as much as any other in all, with c = 0 as often as it
    is shown.
    """
    share = frequencies.weight / frequencies.weight.mean()
    return share[actions] ** -exponent
