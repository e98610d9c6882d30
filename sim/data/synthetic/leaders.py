"""Finds who drives ahead of whom."""

import numpy as np
from jaxtyping import Float, Int

from . import lane_changes
from .courses import Courses
from .lane_changes import Bodies, Changes

LEAST_GAP = 0.01  # metres


def bodies_of(
    courses: Courses,
    length: Float[np.ndarray, " drivers"],
    station: Float[np.ndarray, " drivers"],
    speed: Float[np.ndarray, " drivers"],
    changes: Changes,
) -> Bodies:
    """Returns the drivers in their lanes, then those who change in their old ones."""
    half = length / 2
    lane, rear = _lane(courses, length, station)
    is_there = station + half < courses.end
    none = lane_changes.NONE
    lane = np.where(is_there, lane, none)
    both = lane_changes.is_in_both(changes, station) & is_there
    if not both.any():
        return Bodies(lane=lane, rear=rear, length=length, speed=speed)
    old_rear = station + changes.old_shift - half
    return Bodies(
        lane=np.concatenate([lane, np.where(both, changes.old_lane, none)]),
        rear=np.concatenate([rear, old_rear]),
        length=np.tile(length, 2),
        speed=np.tile(speed, 2),
    )


def nearest(
    courses: Courses,
    bodies: Bodies,
    front: Float[np.ndarray, " drivers"],
    length: Float[np.ndarray, " drivers"],
) -> tuple[Float[np.ndarray, " drivers"], Float[np.ndarray, " drivers"]]:
    """Returns the gap to the next body on each driver's way [m], and its speed."""
    num = len(front)
    kept = np.flatnonzero(bodies.lane >= 0)
    lane, rear = bodies.lane[kept], bodies.rear[kept]
    if not len(kept):
        return np.full(num, np.inf), np.zeros(num)
    place = courses.entry[:, lane] + rear
    # Where a way does not lead through a lane, this compares with NaN and is False.
    ahead = place > (front - length)[:, None]
    ahead &= rear < courses.reach[:, lane]
    ahead &= kept % num != np.arange(num)[:, None]
    place = np.where(ahead, place, np.inf)
    leader = np.argmin(place, axis=1)
    gap = place[np.arange(num), leader] - front
    speed = np.where(gap < np.inf, bodies.speed[kept][leader], 0.0)
    return np.maximum(gap, LEAST_GAP), speed


def _lane(
    courses: Courses,
    length: Float[np.ndarray, " drivers"],
    station: Float[np.ndarray, " drivers"],
) -> tuple[Int[np.ndarray, " drivers"], Float[np.ndarray, " drivers"]]:
    """Returns the lane in which each driver's rear is, and where in it [m]."""
    rear = station - length / 2
    rows = np.arange(len(station))
    place = np.maximum(np.sum(rear[:, None] >= courses.begin, axis=1) - 1, 0)
    return courses.lane[rows, place], rear - courses.begin[rows, place]
