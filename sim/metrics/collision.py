"""Tells whether an object's box overlaps another's (W 3.4)."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from .. import geometry
from .base import Measure, Metric, Moment


def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where the box overlaps another valid object's, seen from above."""
    motion, size = moment.after, moment.object_size
    overlap = geometry.boxes_overlap(
        motion.xy[number, None],
        motion.yaw[number, None],
        size[number, None],
        motion.xy,
        motion.yaw,
        size,
    )
    others = motion.valid & (jnp.arange(len(motion.valid)) != number)
    valid = motion.valid[number]
    hit = jnp.any(overlap & others) & valid
    return Measure(value=hit.astype(jnp.float32), valid=valid)


COLLISION = Metric("collision", False, measure)
