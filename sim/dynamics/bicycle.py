"""Moves a vehicle by acceleration and curvature (W A.1, eq. 2 and 3)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import geometry
from ..motion import Motion
from .base import Action, Continuous, Duration, Dynamics, Size
from .speed import signed_speed

MAX_ACCELERATION = 6.0  # metres per second squared, W 3.4
MAX_CURVATURE = 0.3  # 1 / metres, W 3.4

# Above this speed [m/s] an object moves along its velocity; below, the direction of the
# velocity says less than the pose.
MOVING_SPEED = 0.2
# Below this distance [m] per step a turn says nothing of the curvature.
STANDING_DISTANCE = 1e-3


def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
    """Advances by one step with held acceleration a and curvature k (W eq. 2).

        x' = x + v_x dt + a cos(yaw) dt^2 / 2,   y' likewise
        yaw' = yaw + k (v dt + a dt^2 / 2)
        v' = v + a dt,   v'_x = v' cos(yaw'),   v'_y = v' sin(yaw')

    Actions beyond the limits are clipped. W takes v for the length of the velocity.
    Here it is negative where the velocity points backwards, so that what brakes past
    zero rolls back instead of turning its velocity round at every step, and what
    reverses in the log can be replayed (see `inverse`).
    """
    del size
    acceleration = jnp.clip(action[..., 0], -MAX_ACCELERATION, MAX_ACCELERATION)
    curvature = jnp.clip(action[..., 1], -MAX_CURVATURE, MAX_CURVATURE)
    speed = signed_speed(motion)
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
    fits logs better (W A.1), and against it where it reverses; it is the yaw of the
    pose where the object stands. v is signed as in `forward`: the 738 vehicles that 41
    WOMD scenarios show to the end are then replayed to a mean error of 0.04 m, and the
    6 that reverse to 0.24 m; with unsigned v it was 0.08 m and 4.2 m.
    """
    del size
    speed = signed_speed(after)
    moving = jnp.abs(speed) > MOVING_SPEED
    forwards = jnp.where(speed < 0, -1.0, 1.0)[..., None] * after.velocity
    forwards = jnp.where(moving[..., None], forwards, jnp.array([1.0, 0.0]))
    course = jnp.arctan2(forwards[..., 1], forwards[..., 0])
    yaw = jnp.where(moving, course, after.yaw)
    return held_controls(before, after, yaw - before.yaw, dt)


def held_controls(
    before: Motion, after: Motion, turn: Float[Array, "*objects"], dt: Duration
) -> Action:
    """Returns the acceleration and curvature of a step that turns by an angle.

        a = (v' - v) / dt,   k = turn / (v dt + a dt^2 / 2)

    Args:
        before: the motion before the step.
        after: the motion after the step.
        turn: any angle, wrapped here [rad].
        dt: length of the step [s].

    Returns:
        Both, unclipped; the curvature is 0 where the object stands.
    """
    speed_t, speed_tp1 = signed_speed(before), signed_speed(after)
    acceleration = (speed_tp1 - speed_t) / dt
    distance = speed_t * dt + acceleration * dt**2 / 2
    travels = jnp.abs(distance) >= STANDING_DISTANCE
    curvature = geometry.wrap_angle(turn) / jnp.where(travels, distance, 1.0)
    return jnp.stack([acceleration, jnp.where(travels, curvature, 0.0)], axis=-1)


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
