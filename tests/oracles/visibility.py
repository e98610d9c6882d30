"""Oracle of what a viewer sees (N 3.4), in plain NumPy float64: rays against boxes."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .geometry import Box, corners, heading, wrap_angle

BESIDE = 1e-4  # radians between the rays to a corner


class View(NamedTuple):
    """Where somebody stands, and the sector of a disc in which he looks."""

    xy: Float[np.ndarray, " 2"]  # metres
    yaw: float  # of the axis, radians
    angle: float  # between the sides, radians
    reach: float  # metres


def contains(view: View, point: Float[np.ndarray, " 2"]) -> bool:
    """Tells whether a point lies in the sector."""
    offset = point - view.xy
    turn = wrap_angle(math.atan2(offset[1], offset[0]) - view.yaw)
    return bool(np.hypot(*offset) <= view.reach and abs(turn) <= view.angle / 2)


def sides(box: Box) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns the ends of the four sides [m]."""
    ends = corners(box)
    return [(ends[i], ends[(i + 1) % 4]) for i in range(4)]


def lines_cross(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
) -> tuple[float, float] | None:
    """Returns how far along a-b and c-d their lines meet; None for parallels."""
    u, v, w = b - a, d - c, c - a
    area = u[0] * v[1] - u[1] * v[0]
    if area == 0:
        return None
    share_ab = (w[0] * v[1] - w[1] * v[0]) / area
    share_cd = (w[0] * u[1] - w[1] * u[0]) / area
    return share_ab, share_cd


def is_between(view: View, point: np.ndarray, boxes: Sequence[Box]) -> bool:
    """Tells whether a side of a box crosses the line from the viewer to a point."""
    crossings = (
        lines_cross(view.xy, point, *side) for box in boxes for side in sides(box)
    )
    return any(
        found is not None and 0 <= found[0] <= 1 and 0 <= found[1] <= 1
        for found in crossings
    )


def first_met(view: View, yaw: float, boxes: Sequence[Box]) -> int | None:
    """Returns the number of the box whose side a ray meets first, within reach."""
    end = view.xy + view.reach * heading(yaw)
    nearest, number = 1.0, None
    for i, box in enumerate(boxes):
        for side in sides(box):
            found = lines_cross(view.xy, end, *side)
            if found and 0 <= found[0] <= nearest and 0 <= found[1] <= 1:
                nearest, number = found[0], i
    return number


def directions(view: View, boxes: Sequence[Box]) -> Iterator[float]:
    """Yields the directions of N's rays: corners, crossings, and just beside each."""
    rim = [
        view.xy + view.reach * heading(view.yaw + s * view.angle / 2) for s in (-1, 1)
    ]
    for box in boxes:
        places = list(corners(box))
        for a, b in sides(box):
            shares = [lines_cross(a, b, view.xy, end) for end in rim]
            places += [
                a + found[0] * (b - a)
                for found in shares
                if found and 0 <= found[0] <= 1 and 0 <= found[1] <= 1
            ]
            along, start = b - a, a - view.xy
            roots = np.roots(
                [along @ along, 2 * start @ along, start @ start - view.reach**2]
            )
            places += [a + x.real * along for x in roots if x.imag == 0 <= x.real <= 1]
        for place in places:
            if contains(view, view.xy + (place - view.xy) * (1 - 1e-12)):
                yaw = math.atan2(*(place - view.xy)[::-1])
                yield from (yaw - BESIDE, yaw, yaw + BESIDE)


def visible_boxes(view: View, boxes: Sequence[Box], num_rays: int = 300) -> set[int]:
    """Returns the boxes that N sees, and those that an even fan of rays meets first."""
    half = view.angle / 2
    fan = view.yaw + np.linspace(-half, half, num_rays)
    yaws = [y for y in directions(view, boxes) if abs(wrap_angle(y - view.yaw)) <= half]
    met = {first_met(view, float(yaw), boxes) for yaw in (*yaws, *fan)}
    return {number for number in met if number is not None}
