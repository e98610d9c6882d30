"""Tells whether an object has left the road (W 3.4)."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from .. import geometry
from ..scene_records import Edge
from .base import Measure, Metric, Moment


def corner_edges(moment: Moment, number: Int[Array, ""]) -> Edge:
    """Returns the nearest road edge of each corner of the box, with an axis of four.

    Not valid where the box is not there.
    """
    motion = moment.after
    corners = geometry.box_corners(
        motion.xy[number], motion.yaw[number], moment.object_size[number]
    )
    height = jnp.broadcast_to(motion.xyz[number, 2], (4, 1))
    points = jnp.concatenate([corners, height], axis=-1)
    return moment.scene.nearest_edge(points, motion.valid[number])


def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where a corner of the box lies right of its nearest road edge.

    The nearest edge is sought at the height of the box, so that a bridge is told from
    the road under it. Not valid where the map has no road edge.
    """
    edge = corner_edges(moment, number)
    valid = jnp.all(edge.valid)
    off = jnp.any(edge.signed_distance > 0) & valid
    return Measure(value=off.astype(jnp.float32), valid=valid)


OFFROAD = Metric("offroad", False, measure)
