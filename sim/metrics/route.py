"""Measures the ego against the ways that it could take (W 3.2 and 3.4)."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .. import geometry
from ..records import Record
from ..scene_records import PathSegments
from .base import Measure, Metric, Moment

OFF_ROUTE_DISTANCE = 5.0  # metres from every on-route path
OFF_ROUTE_MARGIN = 2.0  # metres farther than from an off-route path
SAME_PLACE = 0.1  # metres; paths that are equally near are told apart by their order
STANDING = 1e-3  # logs that progress by less [m] count as done from the start


class RoutePosition(Record):
    """The place of a point on the nearest on-route path."""

    arc: Float[Array, ""]  # along the path [m]
    log_arc: Float[Array, " 2"]  # of the log's first and last position on that path
    path: Int[Array, ""]
    distance: Float[Array, ""]  # to the nearest on-route path [m]
    off_route_distance: Float[Array, ""]  # to the nearest other path; inf without one


def locate(paths: PathSegments, xy: Float[Array, " 2"]) -> RoutePosition:
    """Finds the nearest on-route path of a point, and how far the other paths are.

    Paths share lanes, and are simplified apart. Of equally near ones the first counts,
    which passes nearest to the end of the log (see `data.routes`).
    """
    share = geometry.nearest_on_segment(xy[None], paths.start, paths.end)
    along = paths.end - paths.start
    distance = geometry.norm(xy[None] - paths.start - share[:, None] * along)
    on_route = jnp.where(paths.on_route, distance, jnp.inf)
    others = jnp.where(paths.valid & ~paths.on_route, distance, jnp.inf)
    tied = on_route <= jnp.min(on_route) + SAME_PLACE
    path = jnp.min(jnp.where(tied, paths.path, len(distance)))
    nearest = jnp.argmin(jnp.where(paths.path == path, on_route, jnp.inf))
    return RoutePosition(
        arc=paths.arc[nearest] + share[nearest] * geometry.norm(along[nearest]),
        log_arc=paths.log_arc[nearest],
        path=path,
        distance=jnp.min(on_route),
        off_route_distance=jnp.min(others),
    )


def locate_object(moment: Moment, number: Int[Array, ""]) -> RoutePosition:
    """Finds an object on the paths of its scene.

    Each metric of routes asks for it, and XLA answers once: the calls are equal.
    """
    return locate(moment.scene.path_segments(), moment.after.xy[number])


def progress(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns (d(x_t) - d_p) / (d_q - d_p) along the nearest on-route path (W 3.4).

    d_p and d_q are where the log begins and ends on that path; 1 where they agree.
    """
    place = locate_object(moment, number)
    start, end = place.log_arc
    stands = jnp.abs(end - start) < STANDING
    ratio = (place.arc - start) / jnp.where(stands, 1.0, end - start)
    return Measure(
        value=jnp.where(stands, 1.0, ratio), valid=moment.after.valid[number]
    )


def off_route(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where the object follows no on-route path (`definitions.md` section 3).

    It is farther than 5 m from each, or more than 2 m farther from them than from some
    off-route path.
    """
    place = locate_object(moment, number)
    off = place.distance > OFF_ROUTE_DISTANCE
    off |= place.distance > place.off_route_distance + OFF_ROUTE_MARGIN
    valid = moment.after.valid[number]
    return Measure(value=(off & valid).astype(jnp.float32), valid=valid)


def route_distance(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns the distance to the nearest on-route path [m]."""
    place = locate_object(moment, number)
    return Measure(value=place.distance, valid=moment.after.valid[number])


PROGRESS = Metric("progress", True, progress)
OFF_ROUTE = Metric("offroute", True, off_route)
ROUTE_DISTANCE = Metric("route_distance", True, route_distance)
