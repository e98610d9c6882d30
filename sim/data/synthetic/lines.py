"""Draws the lines of generated maps in a plane.

Points come from sines and cosines, whose last bit differs between machines: `snap` puts
them on a grid, so that one seed gives one scenario everywhere.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

STEP = 0.8  # metres between the points of a line
GRID = 2.0**16  # per metre, per radian or whatever is snapped
RAMP = 0.2  # of a bend's length in which its curvature grows, and again falls
LEAST_TURN = 0.3  # radians; below, two poses are joined by a shift instead of a bend
LEAST_STRAIGHT = 1e-6  # metres
LEAST_TANGENT = 2.0  # metres of a bend on either side of its corner

Line = Float[np.ndarray, "_ 2"]  # points, each line with a number of its own


class Pose(NamedTuple):
    """A place and a direction in the plane."""

    x: float  # metres
    y: float
    yaw: float  # radians


def snap(values: np.ndarray) -> np.ndarray:
    """Returns the values on a grid of 1 / 65,536."""
    return np.round(values * GRID) / GRID


def snapped(value: float) -> float:
    """Returns one value on the grid."""
    return round(float(value) * GRID) / GRID


def bend(
    curvature: Float[np.ndarray, " cells"], step: float
) -> tuple[Line, Float[np.ndarray, " points"]]:
    """Returns points and headings of a line from the origin along +x.

    Args:
        curvature: of each stretch [1/m].
        step: length of a stretch [m].
    """
    yaw = np.append(0.0, np.cumsum(curvature * step))
    middle = (yaw[1:] + yaw[:-1]) / 2
    stretch = step * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(stretch, axis=0)]), yaw


def arc(angle: float, num_cells: int) -> Float[np.ndarray, " cells"]:
    """Returns the turn per cell of a bend: it eases in, holds, and eases out.

    Curvature that grows linearly makes clothoids, as roads have.
    """
    place = (np.arange(num_cells) + 0.5) / num_cells
    shape = np.minimum(1.0, np.minimum(place, 1.0 - place) / RAMP)
    return angle * shape / shape.sum()


def offset(
    xy: Line,
    yaw: Float[np.ndarray, " points"],
    distance: float | Float[np.ndarray, " points"],
) -> Line:
    """Returns the line that runs `distance` metres to the left."""
    normal = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
    return xy + np.reshape(distance, (-1, 1)) * normal


def rotate(
    xy: Float[np.ndarray, "*any 2"], angle: float
) -> Float[np.ndarray, "*any 2"]:
    """Returns the points turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def placed(xy: Float[np.ndarray, "*any 2"], pose: Pose) -> Float[np.ndarray, "*any 2"]:
    """Returns points that are given from a pose, forward and left, in the plane."""
    return rotate(xy, pose.yaw) + np.array([pose.x, pose.y])


def seen_from(xy: Float[np.ndarray, "*any 2"], pose: Pose) -> np.ndarray:
    """Returns points of the plane as a pose sees them, forward and left."""
    return rotate(xy - np.array([pose.x, pose.y]), -pose.yaw)


def ahead(pose: Pose, forward: float, left: float = 0.0, turn: float = 0.0) -> Pose:
    """Returns the pose that lies forward and left of another and is turned."""
    x, y = placed(np.array([forward, left]), pose)
    return Pose(float(x), float(y), pose.yaw + turn)


def turned_round(pose: Pose) -> Pose:
    """Returns the pose that looks back."""
    return Pose(pose.x, pose.y, pose.yaw + np.pi)


def wrap(angle: float) -> float:
    """Returns the angle [rad] in [-pi, pi)."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def stations(xy: Line) -> Float[np.ndarray, " points"]:
    """Returns the distance along a line up to each of its points [m]."""
    edge = np.diff(xy, axis=0)
    return np.append(0.0, np.cumsum(np.sqrt(edge[:, 0] ** 2 + edge[:, 1] ** 2)))


def resample(xy: Line, step: float = STEP) -> Line:
    """Returns the line with points about `step` metres apart, its ends unchanged."""
    station = stations(xy)
    num_cells = max(round(float(station[-1]) / step), 1)
    places = np.linspace(0.0, station[-1], num_cells + 1)
    line = np.stack([np.interp(places, station, values) for values in xy.T], axis=-1)
    line[0], line[-1] = xy[0], xy[-1]
    return line


def straight(begin: Pose, length: float) -> Line:
    """Returns a straight line from a pose on."""
    num_cells = max(round(length / STEP), 1)
    forward = np.linspace(0.0, length, num_cells + 1)
    return placed(np.stack([forward, np.zeros_like(forward)], axis=-1), begin)


def join(begin: Pose, end: Pose) -> Line:
    """Returns a smooth line from one pose to another, 0.8 m from point to point.

    Where they turn, it is straight, a bend that eases in and out, and straight; where
    they hardly do, a cubic curve (Bezier) that shifts aside.
    """
    to_end = seen_from(np.array([end.x, end.y]), begin)
    turn = wrap(end.yaw - begin.yaw)
    if abs(turn) >= LEAST_TURN:
        after = to_end[1] / np.sin(turn)
        before = to_end[0] - after * np.cos(turn)
        if min(before, after) >= LEAST_TANGENT:
            return placed(_bend_between(turn, float(before), float(after)), begin)
    reach = 0.45 * np.sqrt(to_end[0] ** 2 + to_end[1] ** 2)
    back = reach * np.array([np.cos(turn), np.sin(turn)])
    knots = [np.zeros(2), np.array([reach, 0.0]), to_end - back, to_end]
    t = np.linspace(0.0, 1.0, 41)[:, None]
    weights = [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]
    curve = sum(w * knot for w, knot in zip(weights, knots, strict=True))
    return placed(resample(np.asarray(curve)), begin)


def _bend_between(turn: float, before: float, after: float) -> Line:
    """Returns a bend from the origin along +x that rounds off a corner.

    Args:
        turn: to the left [rad].
        before: from the origin to the corner [m].
        after: from the corner to the end [m].
    """
    tangent = min(before, after)
    xy, _ = bend(arc(turn, 48), 1.0)
    unit = xy[-1, 1] / np.sin(turn)
    xy = xy * (tangent / unit)
    xy[:, 0] += before - tangent
    away = np.array([np.cos(turn), np.sin(turn)])
    end = np.array([before, 0.0]) + after * away
    points = [xy]
    if before - tangent > LEAST_STRAIGHT:
        points.insert(0, np.zeros((1, 2)))
    if after - tangent > LEAST_STRAIGHT:
        points.append(end[None])
    else:
        xy[-1] = end
    return resample(np.concatenate(points))


def headings(xy: Line) -> Float[np.ndarray, " points"]:
    """Returns the headings at the points of a line [rad], without jumps.

    The heading of an edge is that of the curve at its middle.
    """
    station = stations(xy)
    edge = np.diff(xy, axis=0)
    heading = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
    return np.interp(station, (station[1:] + station[:-1]) / 2, heading)
