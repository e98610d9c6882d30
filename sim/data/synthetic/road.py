"""Draws roads along a line: straight, bent, with a lane that begins or ends."""

import dataclasses
import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...scenario import MapType
from . import lines
from .lines import STEP, Line, Pose
from .piece import Lane, Piece, Port, Shape
from .profile import BIKE_WIDTH, PARKED_SHOULDER, Profile

FOOTWAY = 1.8  # metres between a road edge and the way of pedestrians
PAINTED_SHOULDER = 0.8  # metres; a narrower shoulder has no line beside it
PARKED_SIDE = 1.2  # metres from the edge to the middle of a parked car
TAPER = 36.0  # metres in which a lane begins or ends
CLEAR_END = 9.0  # metres before an end of the road where nobody parks
DRIVEWAY_SHARE = 0.15  # of the roads
FAST = 24.0  # metres per second from which on a road is a freeway
MAX_TIGHTNESS = 1 / 25  # curvature of the middle of a road [1/m]


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Side:
    """One direction of a road, along the way of its traffic."""

    lanes: tuple[Lane, ...]
    begins: tuple[int, ...]  # indices among `lanes`
    ends: tuple[int, ...]
    successor: tuple[tuple[int, int], ...]
    neighbor: tuple[tuple[int, int], ...]
    shapes: tuple[Shape, ...]
    footway: Line
    curb: Line | None


def road(curvature: Float[np.ndarray, " cells"], begin: Profile, end: Profile) -> Piece:
    """Lays a road along a line from the origin; the profiles differ in lanes alone.

    Args:
        curvature: of its middle, for each stretch of 0.8 m [1/m].
        begin: what it looks like where it begins, looking along it.
        end: and where it ends.
    """
    xy, yaw = lines.bend(curvature, STEP)
    right = _side(xy, yaw, begin, (begin.right, end.right))
    left = _side(xy[::-1], yaw[::-1] + np.pi, begin, (end.left, begin.left))
    num = len(right.lanes)

    def of_left(indices: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(num + i for i in indices)

    far = Pose(float(xy[-1, 0]), float(xy[-1, 1]), float(yaw[-1]))
    return Piece(
        kind="road",
        ports=(
            Port(
                pose=Pose(0.0, 0.0, np.pi),
                profile=begin.reversed(),
                begins=right.begins,
                ends=of_left(left.ends),
            ),
            Port(pose=far, profile=end, begins=of_left(left.begins), ends=right.ends),
        ),
        lanes=right.lanes + left.lanes,
        successor=(*right.successor, *((num + a, num + b) for a, b in left.successor)),
        neighbor=(*right.neighbor, *((num + a, num + b) for a, b in left.neighbor)),
        shapes=(*_middle(xy, yaw, begin), *right.shapes, *left.shapes),
        footways=(right.footway, left.footway),
        curbs=tuple(s.curb for s in (right, left) if s.curb is not None),
    )


def with_driveways(generator: np.random.Generator, piece: Piece) -> Piece:
    """Returns the road with some driveways beside it, or more often without."""
    num = int(generator.integers(1, 5)) * (generator.uniform() < DRIVEWAY_SHARE)
    shapes = []
    for _ in range(num):
        way = piece.footways[int(generator.integers(len(piece.footways)))]
        at = int(generator.integers(1, len(way)))
        x, y = way[at].tolist()
        along = way[at] - way[at - 1]
        corner = Pose(x, y, float(np.arctan2(along[1], along[0])))
        wide, deep = generator.uniform(4.0, 7.0), -generator.uniform(3.0, 7.0)
        near = FOOTWAY - 0.3  # a footway lies on the right of its direction of traffic
        box = [[0, near], [wide, near], [wide, deep], [0, deep], [0, near]]
        shapes.append((MapType.DRIVEWAY, lines.placed(np.array(box, float), corner)))
    return dataclasses.replace(piece, shapes=(*piece.shapes, *shapes))


def curvature(
    generator: np.random.Generator, length: float, largest: float
) -> Float[np.ndarray, " cells"]:
    """Draws a road's curvature: straight, a bend to one side, and straight again.

    Args:
        generator: draws angle and places.
        length: of the road [m].
        largest: angle of the bend [rad], reached where the road is long enough.
    """
    num_cells = max(round(length / STEP), 8)
    begin = round(num_cells * generator.uniform(0.0, 0.4))
    num_bent = max(round((num_cells - begin) * generator.uniform(0.4, 1.0)), 4)
    num_bent = min(num_bent, num_cells - begin)
    # An eased bend is tighter in its middle than on average.
    limit = MAX_TIGHTNESS * num_bent * STEP * (1 - lines.RAMP)
    angle = min(generator.uniform(0.0, largest), limit) * generator.choice([-1.0, 1.0])
    result = np.zeros(num_cells)
    result[begin : begin + num_bent] = lines.arc(angle, num_bent) / STEP
    return result


def _side(
    xy: Line,
    yaw: Float[np.ndarray, " points"],
    profile: Profile,
    num_lanes: tuple[int, int],
) -> _Side:
    """Returns one direction of a road with so many lanes at its begin and its end."""
    first, last = num_lanes
    num, width = max(first, last), profile.lane_width
    share = _taper(len(xy)) if first != last else np.zeros(len(xy))
    share = 1.0 - share if last > first else share  # of the outer lane that is gone
    # Where the last lane is gone, it has moved upon the one before it.
    shift = np.zeros((num, len(xy)))
    if first != last:
        shift[-1] = share * width
    offsets = [profile.lane_offset(i) - shift[i] for i in range(num)]
    fast = profile.limit >= FAST
    kind = MapType.LANE_FREEWAY if fast else MapType.LANE_SURFACE_STREET
    whole = [lines.offset(xy, yaw, -o) for o in offsets]
    cut = _cut(whole, first, last, share)
    lanes = [
        Lane(line=line, width=width, limit=profile.limit, map_type=kind, rank=rank)
        for line, rank in cut.ranked
    ]
    outer = profile.half_width(num) - shift[-1] if num else np.full(len(xy), 0.6)
    if profile.has_bike_lanes and num:
        side = outer - profile.shoulder + BIKE_WIDTH / 2
        line = lines.offset(xy, yaw, -side)
        bike = MapType.LANE_BIKE
        lanes.append(Lane(line=line, width=BIKE_WIDTH, limit=8.0, map_type=bike))
    clear = round(CLEAR_END / STEP)
    curb = None
    if num and profile.shoulder >= PARKED_SHOULDER and len(xy) > 2 * clear + 12:
        curb = lines.offset(xy, yaw, PARKED_SIDE - outer)[clear:-clear]
    return _Side(
        lanes=tuple(lanes),
        begins=cut.begins,
        ends=cut.ends,
        successor=cut.successor,
        neighbor=cut.neighbor,
        shapes=_markings(xy, yaw, profile, num, outer),
        footway=lines.offset(xy, yaw, -outer - FOOTWAY),
        curb=curb,
    )


class _Cut(NamedTuple):
    """The lanes of one direction, tied together where one begins or ends."""

    ranked: list[tuple[Line, int]]  # lines, and their right of way
    begins: tuple[int, ...]
    ends: tuple[int, ...]
    successor: tuple[tuple[int, int], ...]
    neighbor: tuple[tuple[int, int], ...]


def _cut(
    whole: list[Line], first: int, last: int, share: Float[np.ndarray, " points"]
) -> _Cut:
    """Cuts lanes where one of them begins or ends, and ties them together.

    Returns:
        The lines with their ranks, the lanes that begin and end the road, successors
        and neighbours. The lane that ends gives way to the one that it runs into.
    """
    num = len(whole)
    if first == last:
        names = tuple(range(num))
        ranked = [(line, 0) for line in whole]
        return _Cut(ranked, names, names, (), beside(names))
    cut = int(np.argmax(share >= 1.0)) if first > last else int(np.argmax(share < 1.0))
    cut = cut if first > last else cut - 1
    head, tail = tuple(range(first)), tuple(range(first, first + last))
    ranked = [(line[: cut + 1], int(i < last)) for i, line in enumerate(whole[:first])]
    ranked += [(line[cut:], 0) for line in whole[:last]]
    if first > last:
        ranked[first - 1] = (_welded(ranked[first - 1][0], whole[last - 1], cut, -1), 0)
    else:
        ranked[-1] = (_welded(ranked[-1][0], whole[first - 1], cut, 0), 0)
    successor = list(zip(head, tail, strict=False))
    successor.append((head[-1], tail[-1]))
    neighbor = (*beside(head), *beside(tail))
    return _Cut(ranked, head, tail, tuple(successor), neighbor)


def _welded(line: Line, onto: Line, point: int, end: int) -> Line:
    """Returns the line with one end exactly at a point of another."""
    line = line.copy()
    line[end] = onto[point]
    return line


def _taper(num_points: int) -> Float[np.ndarray, " points"]:
    """Returns how much of a lane has ended at each point, from 0 to 1, smoothly."""
    length = STEP * (num_points - 1)
    taper = min(TAPER, 0.6 * length)
    t = (STEP * np.arange(num_points) - 0.55 * (length - taper)) / taper
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _markings(
    xy: Line,
    yaw: Float[np.ndarray, " points"],
    profile: Profile,
    num_lanes: int,
    outer: Float[np.ndarray, " points"],
) -> tuple[Shape, ...]:
    """Returns the edge on the right, and the lines left of it."""
    shapes = []
    for lane in range(1, num_lanes):
        side = profile.median / 2 + lane * profile.lane_width
        # A line that an ending lane would leave outside the road ends with it.
        kept = side < outer - profile.shoulder - 0.5
        line = lines.offset(xy, yaw, -side)[kept]
        if len(line) > 1:
            shapes.append((MapType.LINE_BROKEN_SINGLE_WHITE, line))
    if num_lanes and profile.shoulder >= PAINTED_SHOULDER:
        line = lines.offset(xy, yaw, profile.shoulder - outer)
        shapes.append((MapType.LINE_SOLID_SINGLE_WHITE, line))
    shapes.append((MapType.EDGE_BOUNDARY, lines.offset(xy, yaw, -outer)))
    return tuple(shapes)


def _middle(
    xy: Line, yaw: Float[np.ndarray, " points"], profile: Profile
) -> tuple[Shape, ...]:
    """Returns what parts the directions: a median with two edges, or a painted line."""
    if profile.median > 0:
        half = profile.median / 2
        return (
            (MapType.EDGE_MEDIAN, lines.offset(xy, yaw, -half)[::-1]),
            (MapType.EDGE_MEDIAN, lines.offset(xy, yaw, half)),
        )
    if not profile.right or not profile.left:
        return ()
    if profile.is_small:
        return ((MapType.LINE_BROKEN_SINGLE_YELLOW, xy),)
    return ((MapType.LINE_SOLID_DOUBLE_YELLOW, xy),)


def beside(lanes: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Returns the lane changes, both ways, among lanes that lie side by side."""
    pairs = list(itertools.pairwise(lanes))
    return tuple(pairs + [(b, a) for a, b in pairs])
