"""Moves a vehicle by acceleration and steering about its centre (N app. D)."""

import jax.numpy as jnp

from .. import geometry
from ..motion import Motion
from .base import Action, Continuous, Duration, Dynamics, Size
from .speed import signed_speed

# What N lets an imitator choose: acceleration [m/s^2] and steering [rad] ...
LOW = (-6.0, -0.7)
HIGH = (6.0, 0.7)
# ... and a learner from rewards, with the tilt of its head [rad].
HEAD_LOW = (-3.0, -0.7, -1.6)
HEAD_HIGH = (2.0, 0.7, 1.6)

# Turns for which C would be 2 or more have no steering: at 2 it is a quarter turn.
MAX_TURN = 2.0 - 1e-3
# Below this mean speed [m/s] a turn says nothing of the steering.
STANDING_SPEED = 0.01


def forward(motion: Motion, size: Size, action: Action, dt: Duration) -> Motion:
    """Advances by one step with held acceleration a and steering angle s (N app. D).

        u = v + a dt / 2,   beta = atan(tan(s) / 2)
        x' = x + u cos(yaw + beta) dt,   y' = y + u sin(yaw + beta) dt
        yaw' = yaw + u cos(beta) tan(s) / L dt
        v' = v + a dt, along yaw'

    v is the speed along the heading, negative in reverse and never clipped; L is the
    length of the box. Other controls than a and s move nothing.
    """
    acceleration, steering = action[..., 0], action[..., 1]
    speed = signed_speed(motion)
    mean_speed = speed + acceleration * dt / 2
    slip = jnp.arctan(jnp.tan(steering) / 2)
    shift = (mean_speed * dt)[..., None] * geometry.direction(motion.yaw + slip)
    # cos(beta) tan(s) = 2 sin(beta), which stays finite for every steering angle.
    turn = mean_speed * 2 * jnp.sin(slip) / _length(size) * dt
    yaw = geometry.wrap_angle(motion.yaw + turn)
    return motion.replace(
        xyz=jnp.concatenate(
            [motion.xyz[..., :2] + shift, motion.xyz[..., 2:]], axis=-1
        ),
        yaw=yaw,
        velocity=(speed + acceleration * dt)[..., None] * geometry.direction(yaw),
    )


def inverse(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
    """Returns the acceleration and steering between two motions (N app. D), unclipped.

        a = (v' - v) / dt
        s = atan(2 C / sqrt(4 - C^2)),   C = 2 L w / (v + v'),   w = (yaw' - yaw) / dt

    What turns tighter than any steering gets almost a quarter turn; what stands is not
    steered.
    """
    speed_t, speed_tp1 = signed_speed(before), signed_speed(after)
    turn_rate = geometry.wrap_angle(after.yaw - before.yaw) / dt
    speeds = speed_t + speed_tp1
    moving = jnp.abs(speeds) > 2 * STANDING_SPEED
    c = 2 * _length(size) * turn_rate / jnp.where(moving, speeds, 1.0)
    c = jnp.clip(jnp.where(moving, c, 0.0), -MAX_TURN, MAX_TURN)
    steering = jnp.arctan(2 * c / jnp.sqrt(4 - c**2))
    return jnp.stack([(speed_tp1 - speed_t) / dt, steering], axis=-1)


def _length(size: Size):
    """Returns the length of boxes; some number in slots that hold none."""
    return jnp.where(size[..., 0] > 0, size[..., 0], 1.0)


def kinematic_bicycle(*, head_tilt: bool = False) -> Dynamics:
    """Builds the dynamics of N: acceleration [m/s^2] and steering angle [rad].

    Args:
        head_tilt: whether there is a third control, the angle by which the driver looks
            beside the heading [rad]. It moves nothing; observations read it from the
            controls. The inverse looks ahead.
    """
    num_controls = 3 if head_tilt else 2

    def act(before: Motion, after: Motion, size: Size, dt: Duration) -> Action:
        action = inverse(before, after, size, dt)
        ahead = jnp.zeros((*before.yaw.shape, num_controls - 2))
        return jnp.concatenate([action, ahead], axis=-1)

    def coast(motion: Motion, dt: Duration) -> Action:
        del dt
        return jnp.zeros((*motion.yaw.shape, num_controls))

    spec = Continuous(HEAD_LOW, HEAD_HIGH) if head_tilt else Continuous(LOW, HIGH)
    name = "kinematic_bicycle_head" if head_tilt else "kinematic_bicycle"
    return Dynamics(name, spec, forward, act, coast, lambda a: a)
