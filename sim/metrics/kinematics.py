"""Tells whether a vehicle could have made the move (W 3.4)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..dynamics import bicycle
from .base import Measure, Metric, Moment

# Rounding in float32: velocities of 30 m/s over 0.1 s, and a yaw over the least
# distance for which a curvature is formed.
ACCELERATION_SLACK = 1e-3  # metres per second squared
CURVATURE_SLACK = 1e-3  # 1 / metres


def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where the inverse bicycle needs more than its limits.

    |a| > 6 m/s^2 or |k| > 0.3 1/m (W 3.4), each with a slack for rounding. Valid where
    the object was there before and after the step.
    """
    before, after = (
        jax.tree.map(lambda leaf: leaf[number], motion)
        for motion in (moment.before, moment.after)
    )
    size, dt = moment.object_size[number], moment.scene.bank.dt
    acceleration, curvature = bicycle.inverse(before, after, size, dt)
    too_hard = jnp.abs(acceleration) > bicycle.MAX_ACCELERATION + ACCELERATION_SLACK
    too_tight = jnp.abs(curvature) > bicycle.MAX_CURVATURE + CURVATURE_SLACK
    valid = before.valid & after.valid
    return Measure(
        value=((too_hard | too_tight) & valid).astype(jnp.float32), valid=valid
    )


KINEMATIC = Metric("kinematic", False, measure)
