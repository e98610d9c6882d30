"""Tells whether the ego is where no way leads (W 3.4)."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from .base import Measure, Metric, Moment
from .route import locate_object

MAX_DISTANCE = 3.5  # metres from every path


def path_distance(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns the distance to the nearest path, on the route or off it [m]."""
    place = locate_object(moment, number)
    return Measure(
        value=jnp.minimum(place.distance, place.off_route_distance),
        valid=moment.after.valid[number],
    )


def wrong_way(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where the object is farther than 3.5 m from every path.

    Paths lead along lanes the way they are driven; who drives against traffic is soon
    as far from all of them as who leaves the road.
    """
    distance = path_distance(moment, number)
    far = (distance.value > MAX_DISTANCE) & distance.valid
    return Measure(value=far.astype(jnp.float32), valid=distance.valid)


WRONG_WAY = Metric("wrong_way", True, wrong_way)
PATH_DISTANCE = Metric("path_distance", True, path_distance)
