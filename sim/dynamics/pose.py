"""Puts an object where the action says (the state dynamics of W): playback."""

import math

import jax.numpy as jnp

from .. import geometry
from ..motion import Motion
from .base import Action, Continuous, Duration, Dynamics, Size

REACH = 1000.0  # metres from the origin of the scenario; WOMD scenarios span less
MAX_SPEED = 60.0  # metres per second along each axis


def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
    """Takes the next state as it is: (x', y', yaw', v_x', v_y') = action."""
    del size, dt
    return motion.replace(
        xyz=jnp.concatenate([action[..., :2], motion.xyz[..., 2:]], axis=-1),
        yaw=geometry.wrap_angle(action[..., 2]),
        velocity=action[..., 3:],
    )


def inverse(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
    """Returns the state after the step."""
    del before, size, dt
    return _state(after)


def coast(motion: Motion, dt: Duration) -> Action:
    """Returns the state after a step with held velocity and heading."""
    shift = jnp.pad(motion.velocity * dt, [*[(0, 0)] * motion.yaw.ndim, (0, 1)])
    return _state(motion.replace(xyz=motion.xyz + shift))


def _state(motion: Motion) -> Action:
    yaw = motion.yaw[..., None]
    return jnp.concatenate([motion.xyz[..., :2], yaw, motion.velocity], axis=-1)


def pose() -> Dynamics:
    """Builds the pose dynamics: x, y [m], yaw [rad] and v_x, v_y [m/s] after the step.

    All are in the scenario's frame. Driving itself is not clipped to the bounds.
    """
    high = (REACH, REACH, math.pi, MAX_SPEED, MAX_SPEED)
    spec = Continuous(tuple(-bound for bound in high), high)
    return Dynamics("pose", spec, forward, inverse, coast, lambda a: a)
