"""Moves an object by the difference of two poses (W A.1, eq. 1)."""

from typing import Literal

import jax.numpy as jnp

from .. import geometry
from ..motion import Motion
from .base import Action, Continuous, Duration, Dynamics, Size

# What a policy may choose per step of 0.1 s, in the object's frame: forward and left
# [m] and turn [rad]. Driving itself is not clipped.
LOCAL_LOW = (-1.0, -0.5, -0.3)
LOCAL_HIGH = (4.0, 0.5, 0.3)
GLOBAL_LOW = (-4.0, -4.0, -0.3)
GLOBAL_HIGH = (4.0, 4.0, 0.3)


def delta(frame: Literal["local", "global"] = "local") -> Dynamics:
    """Builds the delta dynamics: (dx, dy) [m] and dyaw [rad] of one step.

        x' = x + dx,  y' = y + dy,  yaw' = yaw + dyaw,  v' = (x' - x, y' - y) / dt

    Args:
        frame: whether dx and dy run along the object's axes before the step or the
            map's.
    """

    def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
        del size
        shift = action[..., :2]
        if frame == "local":
            shift = geometry.from_frame(shift, motion.yaw)
        xy = motion.xyz[..., :2] + shift
        return motion.replace(
            xyz=jnp.concatenate([xy, motion.xyz[..., 2:]], axis=-1),
            yaw=geometry.wrap_angle(motion.yaw + action[..., 2]),
            velocity=shift / dt,
        )

    def act(shift, turn, yaw) -> Action:
        if frame == "local":
            shift = geometry.to_frame(shift, yaw)
        return jnp.concatenate([shift, turn[..., None]], axis=-1)

    def inverse(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
        del size, dt
        turn = geometry.wrap_angle(after.yaw - before.yaw)
        return act(after.xyz[..., :2] - before.xyz[..., :2], turn, before.yaw)

    def coast(motion: Motion, dt: Duration) -> Action:
        return act(motion.velocity * dt, jnp.zeros_like(motion.yaw), motion.yaw)

    spec = (
        Continuous(LOCAL_LOW, LOCAL_HIGH)
        if frame == "local"
        else Continuous(GLOBAL_LOW, GLOBAL_HIGH)
    )
    return Dynamics(f"delta_{frame}", spec, forward, inverse, coast, lambda a: a)
