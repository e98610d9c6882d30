"""Draws the roads of generated scenarios: lines that bend, and what lies along them.

Everything is in a local plane; `synthetic` moves it to a place on the map.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float, Int

from ..scenario import MapType

STEP = 0.8  # metres between the points of a road
RAMP = 0.2  # of a bend's length in which its curvature grows, and again falls
PAINTED_SHOULDER = 0.8  # metres; a narrower shoulder has no line beside it
FOOTWAY = 1.6  # metres between a road edge and the way of pedestrians

Line = Float[np.ndarray, "_ 2"]  # points, each line with a number of its own


@dataclasses.dataclass(frozen=True, kw_only=True)
class Profile:
    """What a road looks like across; both directions are alike."""

    num_lanes: int  # in each direction
    lane_width: float  # metres
    shoulder: float  # metres between the outer lane and the edge

    @property
    def half_width(self) -> float:
        """The distance from the middle to an edge [m]."""
        return self.num_lanes * self.lane_width + self.shoulder

    def lane_offset(self, lane: int) -> float:
        """Returns how far right of the middle a lane runs [m]; lane 0 is the inner."""
        return (lane + 0.5) * self.lane_width


@dataclasses.dataclass(frozen=True, kw_only=True)
class Road:
    """A road along a line; traffic keeps right."""

    forward: tuple[Line, ...]  # lanes along the line, the inner one first
    backward: tuple[Line, ...]  # lanes against it, pointing where their traffic goes
    markings: tuple[tuple[MapType, Line], ...]
    right_edge: Line  # along the line
    left_edge: Line  # against it, so that this road too lies on its left
    footways: tuple[Line, Line]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Site:
    """A place with everything that stands still there, and the phases of its lights."""

    kind: str
    profile: Profile
    lanes: tuple[Line, ...]
    shapes: tuple[tuple[MapType, Line], ...]  # the features that are no lanes
    successor: tuple[tuple[int, int], ...]  # pairs of lanes
    neighbor: tuple[tuple[int, int], ...]
    routes: tuple[tuple[int, ...], ...]  # runs of lanes that a driver may take
    ego_route: int
    ego_station: float  # metres along the route
    ego_waits: bool  # at a red light when the log begins
    controlled: tuple[int, ...]  # lanes with a light where they begin
    light_state: Int[np.ndarray, "lights steps"]  # LightState
    footways: tuple[Line, ...]
    crossings: tuple[Line, ...]  # footways across the road
    walk_time: float  # seconds in which pedestrians may cross; 0 where they may not


def bend(
    curvature: Float[np.ndarray, " cells"], step: float
) -> tuple[Line, np.ndarray]:
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


def turn(angle: float, tangent: float, lead: float) -> Line:
    """Returns a right-angled turn from the origin along +x, straight at both ends.

    Args:
        angle: pi / 2 to the left or -pi / 2 to the right.
        tangent: from the beginning of the bend to the corner that it rounds off [m].
        lead: length of the straight before and after [m].
    """
    num_cells = max(16, round(1.7 * tangent / 0.5))
    xy, _ = bend(arc(angle, num_cells), 1.0)
    xy = xy * (tangent / xy[-1, 0])
    straight = np.arange(STEP, lead + STEP / 2, STEP)
    ahead = np.stack([straight, np.zeros_like(straight)], axis=-1)
    away = ahead[:, ::-1] * np.sign(angle)
    line = np.concatenate([-ahead[::-1], xy, xy[-1] + away])
    line[:, 0] += lead
    return line


def offset(xy: Line, yaw: Float[np.ndarray, " points"], distance: float) -> Line:
    """Returns the line that runs `distance` metres to the left."""
    return xy + distance * np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)


def rotate(
    xy: Float[np.ndarray, "*any 2"], angle: float
) -> Float[np.ndarray, "*any 2"]:
    """Returns the points turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


def road(xy: Line, yaw: Float[np.ndarray, " points"], profile: Profile) -> Road:
    """Lays a road along a line."""
    lanes = range(profile.num_lanes)
    half = profile.half_width
    markings = [(MapType.LINE_SOLID_DOUBLE_YELLOW, xy)]
    for side in (-1.0, 1.0):
        for lane in lanes[1:]:
            line = offset(xy, yaw, side * lane * profile.lane_width)
            markings.append((MapType.LINE_BROKEN_SINGLE_WHITE, line))
        if profile.shoulder >= PAINTED_SHOULDER:
            line = offset(xy, yaw, side * profile.num_lanes * profile.lane_width)
            markings.append((MapType.LINE_SOLID_SINGLE_WHITE, line))
    return Road(
        forward=tuple(offset(xy, yaw, -profile.lane_offset(i)) for i in lanes),
        backward=tuple(offset(xy, yaw, profile.lane_offset(i))[::-1] for i in lanes),
        markings=tuple(markings),
        right_edge=offset(xy, yaw, -half),
        left_edge=offset(xy, yaw, half)[::-1],
        footways=(offset(xy, yaw, -half - FOOTWAY), offset(xy, yaw, half + FOOTWAY)),
    )


def beside(lanes: range) -> list[tuple[int, int]]:
    """Returns the lane changes, both ways, among lanes that lie side by side."""
    pairs = list(itertools.pairwise(lanes))
    return pairs + [(b, a) for a, b in pairs]
