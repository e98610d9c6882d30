"""Oracle of the metrics of one step: `definitions.md` section 3, in float64."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from . import dynamics, geometry
from .geometry import Box, boxes_overlap

JOINED_WITHIN = 0.01  # metres; ends of edges this near each other are one vertex
Z_WEIGHT = 2.0  # z counts double in the nearest search


def collision(
    xy: Float[np.ndarray, "objects 2"],
    yaw: Float[np.ndarray, " objects"],
    size: Float[np.ndarray, "objects 3"],
    valid: Bool[np.ndarray, " objects"],
) -> Bool[np.ndarray, " objects"]:
    """Tells which valid objects overlap another valid one.

    Args:
        xy: centres of the boxes [m].
        yaw: of the boxes [rad].
        size: length, width and height [m].
        valid: which objects are there.
    """
    boxes = [
        Box(xy[i], yaw[i], length, width) for i, (length, width, _) in enumerate(size)
    ]
    collides = np.zeros(len(boxes), bool)
    for i in range(len(boxes)):
        for j in range(len(boxes)):
            if i != j and valid[i] and valid[j]:
                collides[i] |= boxes_overlap(boxes[i], boxes[j])
    return collides


def signed_distance(
    point: Float[np.ndarray, " 3"],
    edges: Sequence[Float[np.ndarray, "points 3"]],
    joined_within: float = JOINED_WITHIN,
) -> float:
    """Returns the planar distance to the nearest road edge, positive off the road.

    The nearest place of any edge is sought in (x, y, 2 z). Inside a segment, the side
    is that of the segment. At a vertex, it is the side of the sum of the unit left
    normals of every segment of any edge that ends there. Neither side, as straight
    ahead of an end, counts as the road. Segments without length in the plane are
    skipped.

    Args:
        point: in the map frame [m].
        edges: polylines with the road on their left [m].
        joined_within: how near to a vertex a segment must end to belong to it [m].

    Returns:
        The distance [m]; minus infinity where there is no edge.
    """
    start = np.concatenate([edge[:-1] for edge in edges] or [np.zeros((0, 3))])
    end = np.concatenate([edge[1:] for edge in edges] or [np.zeros((0, 3))])
    has_length = (start[:, :2] != end[:, :2]).any(axis=1)
    start, end = start[has_length], end[has_length]
    if len(start) == 0:
        return -np.inf

    weight = np.array([1.0, 1.0, Z_WEIGHT])
    fraction, foot = geometry.feet(point * weight, start * weight, end * weight)
    nearest = int(np.argmin(np.linalg.norm(point * weight - foot, axis=1)))
    place = foot[nearest] / weight

    if 0 < fraction[nearest] < 1:
        deciding = [nearest]
    else:
        starts_here = np.linalg.norm(start - place, axis=1) <= joined_within
        ends_here = np.linalg.norm(end - place, axis=1) <= joined_within
        deciding = np.flatnonzero(starts_here | ends_here)

    normal = np.zeros(2)
    for segment in deciding:
        along = (end[segment] - start[segment])[:2]
        normal += geometry.left_of(along / np.linalg.norm(along))
    offset = (point - place)[:2]
    distance = float(np.linalg.norm(offset))
    return distance if offset @ normal < 0 else -distance


def offroad(box: Box, z: float, edges: Sequence[Float[np.ndarray, "points 3"]]) -> bool:
    """Tells whether some corner of a box at height z lies off the road."""
    return any(
        signed_distance(np.append(corner, z), edges) > 0
        for corner in geometry.corners(box)
    )


def kinematic_infeasibility(
    before: dynamics.State,
    after: dynamics.State,
    dt: float,
    slack: tuple[float, float],
) -> bool:
    """Tells whether a step asks more of the bicycle than its limits.

    The turn is that of the pose.

    Args:
        before: the state before the step.
        after: the state after the step.
        dt: length of the step [s].
        slack: what is allowed beyond the limits of acceleration [m/s^2] and of
            curvature [1/m].
    """
    acceleration, curvature = dynamics.bicycle_between(
        before, after, after.yaw - before.yaw, dt
    )
    return (
        abs(acceleration) > dynamics.MAX_ACCELERATION + slack[0]
        or abs(curvature) > dynamics.MAX_CURVATURE + slack[1]
    )


def displacement(
    xy: Float[np.ndarray, "objects 2"],
    valid: Bool[np.ndarray, " objects"],
    log_xy: Float[np.ndarray, "objects 2"],
    log_valid: Bool[np.ndarray, " objects"],
) -> tuple[Float[np.ndarray, " objects"], Bool[np.ndarray, " objects"]]:
    """Returns how far each object is from its log [m], and where that is defined.

    The distance is 0 where the object or its log is not valid.
    """
    defined = valid & log_valid
    distance = np.zeros(len(xy))
    for i in np.flatnonzero(defined):
        distance[i] = np.linalg.norm(xy[i] - log_xy[i])
    return distance, defined


def edge_contact(
    box: Box,
    z: float,
    segments: Float[np.ndarray, "segments 2 3"],
    level: float,
) -> bool:
    """Tells whether a closed box at height z meets a segment of a road edge.

    Segments whose middle is more than `level` above or below do not count [m].
    """
    start, end = segments[:, 0], segments[:, 1]
    meets = geometry.box_meets_segments(box, start[:, :2], end[:, :2])
    return bool((meets & (np.abs((start + end)[:, 2] / 2 - z) <= level)).any())


def segments_of(
    edges: Sequence[Float[np.ndarray, "points 3"]],
) -> Float[np.ndarray, "segments 2 3"]:
    """Returns the segments of polylines [m]."""
    return np.concatenate([np.stack([edge[:-1], edge[1:]], axis=1) for edge in edges])


class Light(NamedTuple):
    """A traffic light over one step."""

    xyz: Float[np.ndarray, " 3"]  # stop point [m]
    yaw: float  # of its lane [rad]
    shows: tuple[str, str]  # before and after the step


def runs_red_light(
    before: Box,
    after: Box,
    z: float,
    lights: Sequence[Light],
    half_width: float = 1.75,
    max_turn: float = math.pi / 4,
    level: float = 3.0,
) -> bool:
    """Tells whether the middle of a box's front passes a red light in a step.

    Args:
        before: the box before the step.
        after: the box after the step, along whose yaw it drives.
        z: its height [m].
        lights: of the scene.
        half_width: of the stop line [m].
        max_turn: between the box and the lane [rad].
        level: how far the light may be above or below [m].
    """
    for light in lights:
        if not all(state in ("STOP", "ARROW_STOP") for state in light.shows):
            continue
        along = geometry.heading(light.yaw)
        across = geometry.left_of(along)
        fronts = [
            box.xy + geometry.heading(box.yaw) * box.length / 2 - light.xyz[:2]
            for box in (before, after)
        ]
        first, last = (float(front @ along) for front in fronts)
        if first > 0 or last <= 0:
            continue
        place = fronts[0] + (fronts[1] - fronts[0]) * first / (first - last)
        turn = geometry.wrap_angle(after.yaw - light.yaw)
        if (
            abs(place @ across) <= half_width
            and abs(turn) <= max_turn
            and abs(z - light.xyz[2]) <= level
        ):
            return True
    return False


def goal_reached(
    state: dynamics.State,
    goal: dynamics.State,
    position: float,
    speed: float | None,
    heading: float | None,
) -> bool:
    """Tells whether an object is at its goal, by tolerances of which some may be off.

    Speeds are the lengths of velocities, negative where they point backwards.
    """

    def signed(one: dynamics.State) -> float:
        velocity = np.array([one.vx, one.vy])
        backwards = velocity @ geometry.heading(one.yaw) < 0
        return float(np.linalg.norm(velocity)) * (-1 if backwards else 1)

    reached = math.hypot(state.x - goal.x, state.y - goal.y) < position
    if speed is not None:
        reached &= abs(signed(state) - signed(goal)) < speed
    if heading is not None:
        reached &= abs(geometry.wrap_angle(state.yaw - goal.yaw)) < heading
    return reached
