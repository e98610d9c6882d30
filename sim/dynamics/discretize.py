"""Turns continuous dynamics into discrete ones over a uniform grid of actions."""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..motion import Motion
from .base import Action, Continuous, Discrete, Duration, Dynamics, Size


def to_index(
    action: Float[Array, "*objects features"], spec: Continuous, bins: tuple[int, ...]
) -> Int[Array, "*objects"]:
    """Returns the number of the nearest grid point, ties to the even bin.

    The first feature is the slowest. Values beyond the bounds go to the outermost bin.
    """
    index = jnp.zeros(action.shape[:-1], jnp.int32)
    for i, (low, high, count) in enumerate(zip(spec.low, spec.high, bins, strict=True)):
        position = (action[..., i] - low) / (high - low) * (count - 1)
        nearest = jnp.clip(jnp.round(position), 0, count - 1).astype(jnp.int32)
        index = index * count + nearest
    return index


def to_action(
    index: Int[Array, "*objects"], spec: Continuous, bins: tuple[int, ...]
) -> Float[Array, "*objects features"]:
    """Returns the grid point of a number."""
    nearest = jnp.unravel_index(index, bins)
    features = [
        low + number * ((high - low) / (count - 1))
        for low, high, count, number in zip(
            spec.low, spec.high, bins, nearest, strict=True
        )
    ]
    return jnp.stack(features, axis=-1)


def discretize(dynamics: Dynamics, bins: tuple[int, ...]) -> Dynamics:
    """Builds the discrete form of continuous dynamics: an action is one integer.

    Args:
        dynamics: with a `Continuous` action spec, whose bounds are the grid's ends.
        bins: grid points of each feature, at least two.

    Raises:
        ValueError: if the dynamics are discrete already or the bins do not fit them.
    """
    spec = dynamics.action_spec
    if not isinstance(spec, Continuous):
        raise ValueError(f"{dynamics.name} is discrete already.")
    if len(bins) != len(spec.low) or min(bins) < 2:
        raise ValueError(
            f"bins must be {len(spec.low)} numbers of at least 2 for {dynamics.name}, "
            f"got {bins}."
        )

    def controls(action: Action) -> Float[Array, "*objects features"]:
        return to_action(action, spec, bins)

    def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
        return dynamics.forward(motion, size, controls(action), dt)

    def inverse(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
        return to_index(dynamics.inverse(before, after, size, dt), spec, bins)

    def coast(motion: Motion, dt: Duration) -> Action:
        return to_index(dynamics.coast(motion, dt), spec, bins)

    return Dynamics(
        f"{dynamics.name}_discrete",
        Discrete(math.prod(bins), bins),
        forward,
        inverse,
        coast,
        controls,
    )
