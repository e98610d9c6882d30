"""Oracle of plane geometry, in plain NumPy float64: boxes, angles, polylines."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Box(NamedTuple):
    """An oriented rectangle."""

    xy: Float[np.ndarray, " 2"]  # centre [m]
    yaw: float  # of its length, radians
    length: float  # metres
    width: float  # metres


def wrap_angle(angle: float) -> float:
    """Returns the same direction as an angle in [-pi, pi]."""
    return math.remainder(angle, 2 * math.pi)


def heading(yaw: float) -> Float[np.ndarray, " 2"]:
    """Returns the unit vector that points along a yaw."""
    return np.array([math.cos(yaw), math.sin(yaw)])


def left_of(vector: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
    """Returns the vector turned by a quarter to the left."""
    return np.array([-vector[1], vector[0]])


def corners(box: Box) -> Float[np.ndarray, "4 2"]:
    """Returns the corners: front left, rear left, rear right, front right [m]."""
    front = heading(box.yaw) * box.length / 2
    left = left_of(heading(box.yaw)) * box.width / 2
    return np.array([front + left, left - front, -front - left, front - left]) + box.xy


def boxes_overlap(a: Box, b: Box) -> bool:
    """Tells whether two boxes overlap, by separating axes.

    Boxes that only touch do not overlap.
    """
    for yaw in (a.yaw, b.yaw):
        for axis in (heading(yaw), left_of(heading(yaw))):
            of_a, of_b = corners(a) @ axis, corners(b) @ axis
            if of_a.max() <= of_b.min() or of_b.max() <= of_a.min():
                return False
    return True


def feet(
    point: Float[np.ndarray, " dims"],
    start: Float[np.ndarray, "segments dims"],
    end: Float[np.ndarray, "segments dims"],
) -> tuple[Float[np.ndarray, " segments"], Float[np.ndarray, "segments dims"]]:
    """Finds the nearest place to a point on each of many segments.

    Args:
        point: any point.
        start: where each segment starts.
        end: where each segment ends; may equal its start.

    Returns:
        How far along its segment the place lies, in [0, 1], and the place itself.
    """
    along = end - start
    squared_length = (along**2).sum(axis=1)
    fraction = ((point - start) * along).sum(axis=1)
    fraction /= np.where(squared_length == 0, 1.0, squared_length)
    fraction = np.clip(fraction, 0.0, 1.0)
    return fraction, start + fraction[:, None] * along


def project(
    point: Float[np.ndarray, " 2"], polyline: Float[np.ndarray, "points 2"]
) -> tuple[float, float]:
    """Projects a point onto a polyline of at least two points.

    Returns:
        The distance to the nearest place of the polyline, and the arc length from the
        start of the polyline to that place (the first of several) [m].
    """
    start, end = polyline[:-1], polyline[1:]
    length = np.linalg.norm(end - start, axis=1)
    arc_at_start = np.concatenate([[0.0], np.cumsum(length)[:-1]])

    fraction, foot = feet(point, start, end)
    distance = np.linalg.norm(point - foot, axis=1)
    nearest = int(np.argmin(distance))
    arc = arc_at_start[nearest] + fraction[nearest] * length[nearest]
    return float(distance[nearest]), float(arc)


def direction_at(
    point: Float[np.ndarray, " 2"], polyline: Float[np.ndarray, "points 2"]
) -> float:
    """Returns the yaw of the polyline's first piece that is nearest to a point."""
    start, end = polyline[:-1], polyline[1:]
    _, foot = feet(point, start, end)
    distance = np.linalg.norm(point - foot, axis=1)
    distance[(start == end).all(axis=1)] = np.inf
    along = (end - start)[int(np.argmin(distance))]
    return math.atan2(along[1], along[0])


def box_meets_segments(
    box: Box,
    start: Float[np.ndarray, "segments 2"],
    end: Float[np.ndarray, "segments 2"],
) -> Bool[np.ndarray, " segments"]:
    """Tells which segments share a point with a closed box.

    They start inside the box, or cross one of its sides.
    """
    corner = corners(box)
    meets = np.ones(len(start), bool)
    for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True):
        meets &= _side(a, b, start) >= 0
    for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True):
        apart = _side(a, b, start) * _side(a, b, end) > 0
        apart |= _side(start, end, a) * _side(start, end, b) > 0
        meets |= ~apart & (start != end).any(axis=1)
    return meets


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Returns twice the area of triangles: positive where the point is left of a-b."""
    along, offset = b - a, point - a
    return along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0]
