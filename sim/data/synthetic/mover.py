"""States what a road user of a generated log does, in the plane of the town."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ...scenario import ObjectType
from . import lines
from .lines import Line, Pose, snap, snapped


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mover:
    """One road user at each step; where it is not there, values mean nothing."""

    object_type: ObjectType
    size: Float[np.ndarray, " 3"]  # length, width, height [m]
    xy: Float[np.ndarray, "steps 2"]
    yaw: Float[np.ndarray, " steps"]  # radians
    velocity: Float[np.ndarray, "steps 2"]  # metres per second
    is_there: Bool[np.ndarray, " steps"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Way:
    """A line with what is looked up along it."""

    station: Float[np.ndarray, " points"]  # metres
    xy: Line
    yaw: Float[np.ndarray, " points"]  # radians, without jumps
    curvature: Float[np.ndarray, " points"]  # 1/m


def way(parts: list[Line]) -> Way:
    """Joins lines to one, each beginning where the one before ends."""
    xy = np.concatenate([parts[0], *(line[1:] for line in parts[1:])])
    station, yaw = lines.stations(xy), lines.headings(xy)
    return Way(station=station, xy=xy, yaw=yaw, curvature=np.gradient(yaw, station))


def along(
    way: Way,
    station: Float[np.ndarray, " steps"],
    speed: Float[np.ndarray, " steps"],
    left: Float[np.ndarray, " steps"],
    slope: Float[np.ndarray, " steps"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns position, yaw and velocity of one who follows a way.

    With station s, curvature k and the distance d(s) left of the line, the velocity is
    s' (1 - k d) along the line and s' d'(s) across it.
    """
    x, y, yaw, curvature = (
        np.interp(station, way.station, values)
        for values in (*way.xy.T, way.yaw, way.curvature)
    )
    straight = 1 - curvature * left
    heading = yaw + np.arctan2(slope, straight)
    fast = speed * np.sqrt(straight**2 + slope**2)
    return (
        np.stack([x - left * np.sin(yaw), y + left * np.cos(yaw)], axis=-1),
        heading,
        fast[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1),
    )


def standing(
    object_type: ObjectType, size: Float[np.ndarray, " 3"], pose: Pose, num_steps: int
) -> Mover:
    """Returns one that never moves."""
    return Mover(
        object_type=object_type,
        size=size,
        xy=np.broadcast_to(snap(np.array([pose.x, pose.y])), (num_steps, 2)),
        yaw=np.full(num_steps, snapped(pose.yaw)),
        velocity=np.zeros((num_steps, 2)),
        is_there=np.ones(num_steps, bool),
    )


def walking(
    line: Line,
    station: float,
    speed: float,
    size: Float[np.ndarray, " 3"],
    times: Float[np.ndarray, " steps"],
) -> Mover:
    """Returns a pedestrian on a line, from its begin or later to its end.

    Args:
        line: its way.
        station: where it is at time 0, maybe before the begin [m].
        speed: along the line [m/s].
        size: length, width, height [m].
        times: of the steps [s].
    """
    own = way([line])
    at = station + speed * times
    inside = np.clip(at, 0.0, own.station[-1])
    zeros = np.zeros_like(times)
    is_there = (at >= 0) & (at <= own.station[-1])
    fast = np.full_like(times, speed)
    xy, yaw, velocity = along(own, inside, fast, zeros, zeros)
    return Mover(
        object_type=ObjectType.PEDESTRIAN,
        size=size,
        xy=snap(xy),
        yaw=snap(yaw),
        velocity=snap(velocity),
        is_there=is_there,
    )
