"""Draws freeways in one direction where a ramp merges into them or splits off."""

import numpy as np

from ...scenario import MapType
from . import lines, piece as pieces, road
from .lines import STEP, Line, Pose
from .piece import Lane, Piece
from .profile import MPH, Profile

LENGTH = 260.0  # metres
GORE = 100.0  # metres from the beginning to where ramp and road touch
BESIDE = 60.0  # metres that the ramp runs beside the road as a lane
TAPER = 50.0  # metres in which that lane ends
ANGLE = 0.11  # sideways metres per metre of the ramp before the gore
SHOULDER = 2.2  # metres, right of the outermost lane


def ramp(generator: np.random.Generator) -> Piece:
    """Returns a merge or a split, its middle at the origin.

    A split is a merge driven the other way: everything is mirrored, and lines turn
    round.
    """
    profile = Profile(
        right=int(generator.integers(2, 5)),
        left=0,
        lane_width=round(generator.uniform(3.5, 3.75), 2),
        shoulder=SHOULDER,
        has_bike_lanes=False,
        median=0.0,
        limit=MPH * float(generator.choice([50, 55, 65])),
    )
    is_split = bool(generator.uniform() < 0.5)
    curvature = road.curvature(generator, LENGTH, 0.35)
    xy, yaw = lines.bend(curvature, STEP)
    station = STEP * np.arange(len(xy))
    outer = profile.lane_offset(profile.right - 1)
    aside = _ramp_offset(station, profile.lane_width)
    lane_lines = [
        lines.offset(xy, yaw, -profile.lane_offset(i)) for i in range(profile.right)
    ]
    ending = int(np.argmax(aside < 1e-6))
    own = lines.offset(xy, yaw, -outer - aside)[: ending + 1]
    own[-1] = lane_lines[-1][ending]
    edges = _edges(xy, yaw, profile, aside)
    white = MapType.LINE_BROKEN_SINGLE_WHITE
    marks = [
        (white, lines.offset(xy, yaw, -i * profile.lane_width))
        for i in range(1, profile.right)
    ]
    middle = xy[len(xy) // 2]
    piece = _piece(profile, lane_lines, own, ending, [*marks, *edges], is_split)
    return _about(piece, middle, is_split)


def _ramp_offset(station: np.ndarray, width: float) -> np.ndarray:
    """Returns how far right of the outermost lane the ramp's lane runs [m]."""
    before = np.maximum(GORE - station, 0.0)
    # Away from the gore the ramp bends off smoothly.
    far = width + SHOULDER * np.clip(before / 20.0, 0, 1) + ANGLE * before
    t = np.clip((station - GORE - BESIDE) / TAPER, 0.0, 1.0)
    return _smoothed(far) - width * t * t * (3 - 2 * t)


def _smoothed(values: np.ndarray) -> np.ndarray:
    """Returns moving averages over 24 m, so that kinks become bends."""
    num = 15
    padded = np.concatenate([np.full(num, values[0]), values, np.full(num, values[-1])])
    padded[:num] += (values[0] - values[1]) * np.arange(num, 0, -1)
    total = np.append(0.0, np.cumsum(padded))
    return (total[2 * num + 1 :] - total[: -2 * num - 1]) / (2 * num + 1)


def _edges(
    xy: Line, yaw: np.ndarray, profile: Profile, aside: np.ndarray
) -> list[tuple[MapType, Line]]:
    """Returns the left edge, the right one behind the gore, and those of the ramp."""
    outer = profile.lane_offset(profile.right - 1)
    half = profile.lane_width / 2
    gap = aside - 2 * half - 0.8  # between the shoulders of ramp and road
    apart = int(np.argmax(gap <= 0.0))
    main = lines.offset(xy, yaw, -outer - half - 0.4)[: apart + 1]
    left = lines.offset(xy, yaw, -outer - aside + half + 0.4)[: apart + 1]
    right = lines.offset(xy, yaw, -outer - aside - half - SHOULDER)
    boundary = MapType.EDGE_BOUNDARY
    gore = np.concatenate([main, left[::-1][1:]])
    return [
        (boundary, lines.offset(xy, yaw, 1.2)[::-1]),
        (boundary, gore),
        (boundary, right),
    ]


def _piece(
    profile: Profile,
    lane_lines: list[Line],
    own: Line,
    ending: int,
    shapes: list[tuple[MapType, Line]],
    is_split: bool,
) -> Piece:
    """Ties the lanes together: heads 0 to n - 1, tails n to 2 n - 1, the ramp 2 n."""
    num = profile.right

    def lane(line: Line, rank: int, limit: float) -> Lane:
        return Lane(
            line=_mirrored(line, is_split),
            width=profile.lane_width,
            limit=limit,
            map_type=MapType.LANE_FREEWAY,
            rank=rank,
        )

    slow = 0.75 * profile.limit
    lanes = [lane(line[: ending + 1], 1, profile.limit) for line in lane_lines]
    lanes += [lane(line[ending:], 1, profile.limit) for line in lane_lines]
    lanes.append(lane(own, 0, slow))
    pairs = [(i, num + i) for i in range(num)] + [(2 * num, 2 * num - 1)]
    heads = tuple(range(num))
    tails = tuple(range(num, 2 * num))
    return Piece(
        kind="ramp",
        ports=(),
        lanes=tuple(lanes),
        successor=tuple((b, a) if is_split else (a, b) for a, b in pairs),
        neighbor=(*road.beside(heads), *road.beside(tails)),
        shapes=tuple((kind, _mirrored(line, is_split)) for kind, line in shapes),
    )


def _mirrored(line: Line, is_split: bool) -> Line:
    """Returns the line of a merge, or what it is in a split.

    The mirror puts the road on an edge's right, turning round on its left again.
    """
    return line[::-1] * np.array([1.0, -1.0]) if is_split else line


def _about(piece: Piece, middle: np.ndarray, is_split: bool) -> Piece:
    """Returns the piece with the middle of its road at the origin."""
    y = -middle[1] if is_split else middle[1]
    return pieces.moved(piece, Pose(-float(middle[0]), -float(y), 0.0))
