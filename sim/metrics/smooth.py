"""Costs with gradients: how far an object is inside others, and off the road.

They stand in for collision and off-road where a learner differentiates the simulator.
Both soften a length x, positive where something is wrong, to

    c = s log(1 + exp(x / s)):

almost x where x is much larger than the softness s, almost 0 where it is much less, and
0.7 s at the limit. Gradients exist wherever x has one: not where two sides, corners or
road edges are equally near.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .. import geometry
from .base import Measure, Metric, Moment
from .offroad import corner_edges

SOFTNESS = 0.25  # metres


def collision(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns how deep the box lies in all other valid boxes, softened [m].

    The depth in a box is minus the gap along that of the four sides' directions in
    which the boxes are farthest apart. It is the shortest shift that parts boxes that
    overlap; of others, the gap is never more than the distance.
    """
    motion, size = moment.after, moment.object_size
    others = motion.valid & (jnp.arange(len(motion.valid)) != number)
    own = motion.xy[number, None], motion.yaw[number, None], size[number, None]
    gap = geometry.boxes_gap(*own, motion.xy, motion.yaw, size)
    depth = jnp.where(others, -gap, 0.0)
    valid = motion.valid[number]
    cost = jnp.sum(jnp.where(others, _soften(depth), 0.0))
    return Measure(value=jnp.where(valid, cost, 0.0), valid=valid)


def offroad(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns how far off the road the farthest corner of the box is, softened [m].

    Nearest edges are sought as for the metric. Not valid where the map has none.
    """
    edge = corner_edges(moment, number)
    valid = jnp.all(edge.valid)
    farthest = jnp.max(edge.signed_distance)
    return Measure(value=jnp.where(valid, _soften(farthest), 0.0), valid=valid)


def _soften(length: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    return SOFTNESS * jax.nn.softplus(length / SOFTNESS)


SMOOTH_COLLISION = Metric("smooth_collision", False, collision)
SMOOTH_OFFROAD = Metric("smooth_offroad", False, offroad)
