"""Lets policies choose actions between -1 and 1 (W A.1)."""

import jax.numpy as jnp
import numpy as np

from ..motion import Motion
from .base import Action, Continuous, Duration, Dynamics, Size


def normalize(dynamics: Dynamics) -> Dynamics:
    """Builds the same dynamics with actions from -1 to 1 between their bounds.

    The controls remain those of the dynamics, with their units.

    Args:
        dynamics: with a `Continuous` action spec.

    Raises:
        ValueError: if the dynamics are discrete.
    """
    spec = dynamics.action_spec
    if not isinstance(spec, Continuous):
        raise ValueError(
            f"{dynamics.name} is discrete and has no bounds to normalize; normalize "
            "the continuous dynamics first."
        )
    low, high = np.array(spec.low, np.float32), np.array(spec.high, np.float32)
    middle, half = (high + low) / 2, (high - low) / 2

    def scaled(action: Action) -> Action:
        shape = action.shape
        return jnp.broadcast_to(middle, shape) + jnp.broadcast_to(half, shape) * action

    def unscaled(action: Action) -> Action:
        shape = action.shape
        offset = action - jnp.broadcast_to(middle, shape)
        return offset / jnp.broadcast_to(half, shape)

    def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
        return dynamics.forward(motion, size, scaled(action), dt)

    def inverse(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
        return unscaled(dynamics.inverse(before, after, size, dt))

    def coast(motion: Motion, dt: Duration) -> Action:
        return unscaled(dynamics.coast(motion, dt))

    return Dynamics(
        f"{dynamics.name}_normalized",
        Continuous((-1.0,) * len(low), (1.0,) * len(low)),
        forward,
        inverse,
        coast,
        lambda action: dynamics.controls(scaled(action)),
    )
