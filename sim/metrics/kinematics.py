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
    """Returns 1 where a bicycle needs more than its limits for the step.

    |a| > 6 m/s^2 or |k| > 0.3 1/m (W 3.4), each with a slack for rounding. Valid where
    the object was there before and after the step.

    The turn is that of the pose. The inverse dynamics turn from the pose to the
    direction of the velocity, which corrects a simulated car, but counts the slip of a
    logged box as curvature at each step: it flags 46 % of the logged episodes of 41
    WOMD egos that delta dynamics replay (41 % by curvature, 20 % by acceleration),
    where W table 3 has 4.33 %. The turn of the velocity flags 22 % (7 % and 20 %), but
    46 % where positions are stored to the centimetre. The turn of the pose flags 20 %
    (0 % and 20 %), and 17 % to the centimetre. Of these, 5 % have a step twice as long
    as its neighbours, of 50 m/s^2; the others need 6 to 10 m/s^2, by differences of
    logged positions that the logged velocities do not show.
    """
    before, after = (
        jax.tree.map(lambda leaf: leaf[number], motion)
        for motion in (moment.before, moment.after)
    )
    acceleration, curvature = bicycle.held_controls(
        before, after, after.yaw - before.yaw, moment.scene.bank.dt
    )
    too_hard = jnp.abs(acceleration) > bicycle.MAX_ACCELERATION + ACCELERATION_SLACK
    too_tight = jnp.abs(curvature) > bicycle.MAX_CURVATURE + CURVATURE_SLACK
    valid = before.valid & after.valid
    return Measure(
        value=((too_hard | too_tight) & valid).astype(jnp.float32), valid=valid
    )


KINEMATIC = Metric("kinematic", False, measure)
