"""Tells whether an object touches a road edge: Nocturne's collision with edges."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from ..map_search import FAR
from ..scenario import SAME_LEVEL
from .base import Measure, Metric, Moment


def edge_contact(level: float = SAME_LEVEL) -> Metric:
    """Builds the metric.

    Args:
        level: edges whose height differs by more [m] belong to another road; infinity
            for Nocturne's plane world.

    Returns:
        The metric that is 1 where the closed box, seen from above, meets a segment of
        a road edge. Other than off-road it does not ask for the side: who has crossed
        the edge whole touches it no more.
    """

    def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
        after, valid = moment.after, moment.after.valid[number]
        touches = moment.scene.touches_edge(
            jnp.where(valid, after.xyz[number], FAR),
            after.yaw[number],
            moment.object_size[number],
            level,
        )
        return Measure(value=(touches & valid).astype(jnp.float32), valid=valid)

    return Metric("edge_contact", False, measure)


EDGE_CONTACT = edge_contact()
