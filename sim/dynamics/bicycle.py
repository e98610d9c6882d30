"""Moves a vehicle by acceleration and curvature (W A.1, eq. 2 and 3)."""

import jax.numpy as jnp

from .. import geometry
from ..motion import Motion
from .base import Action, Continuous, Duration, Dynamics, Size

MAX_ACCELERATION = 6.0  # metres per second squared, W 3.4
MAX_CURVATURE = 0.3  # 1 / metres, W 3.4

# Above this speed [m/s] an object moves along its velocity. Full braking from rest
# makes 0.6 m/s backwards in one step, which must not be taken for a half turn.
MOVING_SPEED = 0.65
# Below this distance [m] per step a turn says nothing of the curvature.
STANDING_DISTANCE = 1e-3


def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
    """Advances by one step with held acceleration a and curvature k (W eq. 2).

        x' = x + v_x dt + a cos(yaw) dt^2 / 2,   y' likewise
        yaw' = yaw + k (v dt + a dt^2 / 2)
        v' = v + a dt,   v'_x = v' cos(yaw'),   v'_y = v' sin(yaw')

    Actions beyond the limits are clipped.
    """
    del size
    acceleration = jnp.clip(action[..., 0], -MAX_ACCELERATION, MAX_ACCELERATION)
    curvature = jnp.clip(action[..., 1], -MAX_CURVATURE, MAX_CURVATURE)
    speed = motion.speed
    heading = geometry.direction(motion.yaw)
    distance = speed * dt + acceleration * dt**2 / 2
    yaw = geometry.wrap_angle(motion.yaw + curvature * distance)
    xy = (
        motion.xyz[..., :2]
        + motion.velocity * dt
        + (acceleration * dt**2 / 2)[..., None] * heading
    )
    return motion.replace(
        xyz=jnp.concatenate([xy, motion.xyz[..., 2:]], axis=-1),
        yaw=yaw,
        velocity=(speed + acceleration * dt)[..., None] * geometry.direction(yaw),
    )


def inverse(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
    """Returns the acceleration and curvature between two motions (W eq. 3), unclipped.

        a = (v' - v) / dt
        k = (yaw_v' - yaw) / (v dt + a dt^2 / 2)

    yaw_v' is the direction of the velocity after the step where the object moves, which
    fits logs better (W A.1), and the yaw of the pose where it stands.
    """
    del size
    speed_t, speed_tp1 = before.speed, after.speed
    acceleration = (speed_tp1 - speed_t) / dt
    moving = speed_tp1 > MOVING_SPEED
    velocity = jnp.where(moving[..., None], after.velocity, jnp.array([1.0, 0.0]))
    course = jnp.arctan2(velocity[..., 1], velocity[..., 0])
    turn = geometry.wrap_angle(jnp.where(moving, course, after.yaw) - before.yaw)
    distance = speed_t * dt + acceleration * dt**2 / 2
    travels = jnp.abs(distance) >= STANDING_DISTANCE
    curvature = jnp.where(travels, turn / jnp.where(travels, distance, 1.0), 0.0)
    return jnp.stack([acceleration, curvature], axis=-1)


def coast(motion: Motion, dt: Duration) -> Action:
    """Returns no acceleration and no curvature."""
    del dt
    return jnp.zeros((*motion.yaw.shape, 2))


def bicycle() -> Dynamics:
    """Builds the bicycle dynamics: acceleration [m/s^2] and curvature [1/m]."""
    spec = Continuous(
        (-MAX_ACCELERATION, -MAX_CURVATURE), (MAX_ACCELERATION, MAX_CURVATURE)
    )
    return Dynamics("bicycle", spec, forward, inverse, coast, lambda a: a)
