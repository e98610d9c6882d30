"""Tells whether an object's box overlaps another's (W 3.4)."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from .. import box_search
from ..box_search import Boxes
from .base import Measure, Metric, Moment


def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where the box overlaps another valid object's, seen from above.

    Boxes that only touch do not overlap. Nocturne's do, but none of its oracle's 14,000
    placements lies on that line.
    """
    after = moment.after
    boxes = Boxes(
        xy=after.xy, yaw=after.yaw, size=moment.object_size, valid=after.valid
    )
    valid = after.valid[number]
    hit = box_search.overlaps(boxes, number) & valid
    return Measure(value=hit.astype(jnp.float32), valid=valid)


COLLISION = Metric("collision", False, measure)
