"""States what a piece of a generated town is: ports, lanes and what lies beside."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from ...scenario import MapType
from .lines import Line, Pose, placed, snap
from .profile import Profile

Turn = Literal["right", "ahead", "left"]
Shape = tuple[MapType, Line]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lane:
    """One lane, along the way of its traffic."""

    line: Line
    width: float  # metres
    limit: float  # metres per second
    map_type: MapType = MapType.LANE_SURFACE_STREET
    turn: Turn | None = None  # of a lane across a junction
    rank: int = 0  # where lanes of a piece cross, the higher one goes first
    group: int | None = None  # of the piece's signals, that stops it where it begins
    stops: bool = False  # at a sign where it begins


@dataclasses.dataclass(frozen=True, kw_only=True)
class Port:
    """Where another piece can be joined; the pose lies in the middle and looks out."""

    pose: Pose
    profile: Profile  # as seen by the pose
    begins: tuple[int, ...]  # lanes that come in here, the inner one first
    ends: tuple[int, ...]  # lanes that lead out here


@dataclasses.dataclass(frozen=True, kw_only=True)
class Crossing:
    """A way for pedestrians across one arm of a junction."""

    line: Line  # from beside the road to beside the road
    group: int | None  # of the signals that must be red for one to cross


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signals:
    """The phases of one set of lights; each gives green to groups of lanes."""

    phases: tuple[frozenset[int], ...]
    protected: frozenset[int]  # groups that turn left while nobody comes towards them
    num_groups: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Piece:
    """A part of a town in a plane of its own. Lanes are named by their index."""

    kind: str
    ports: tuple[Port, ...]
    lanes: tuple[Lane, ...]
    successor: tuple[tuple[int, int], ...] = ()
    neighbor: tuple[tuple[int, int], ...] = ()
    shapes: tuple[Shape, ...] = ()  # features that are no lanes
    signs: tuple[tuple[Pose, tuple[int, ...]], ...] = ()  # stop signs and their lanes
    signals: Signals | None = None
    crossings: tuple[Crossing, ...] = ()
    footways: tuple[Line, ...] = ()
    curbs: tuple[Line, ...] = ()  # where cars park, in the direction that they face
    stalls: tuple[Pose, ...] = ()  # places of a car park


def moved(piece: Piece, pose: Pose) -> Piece:
    """Returns the piece with its origin at a pose, on the grid."""

    def line(xy: Line) -> Line:
        return snap(placed(xy, pose))

    def place(own: Pose) -> Pose:
        x, y = placed(_point(own), pose)
        return Pose(float(x), float(y), own.yaw + pose.yaw)

    return dataclasses.replace(
        piece,
        ports=tuple(
            dataclasses.replace(port, pose=place(port.pose)) for port in piece.ports
        ),
        lanes=tuple(
            dataclasses.replace(lane, line=line(lane.line)) for lane in piece.lanes
        ),
        shapes=tuple((kind, line(xy)) for kind, xy in piece.shapes),
        signs=tuple((place(sign), lanes) for sign, lanes in piece.signs),
        crossings=tuple(
            dataclasses.replace(crossing, line=line(crossing.line))
            for crossing in piece.crossings
        ),
        footways=tuple(line(way) for way in piece.footways),
        curbs=tuple(line(curb) for curb in piece.curbs),
        stalls=tuple(place(stall) for stall in piece.stalls),
    )


def _point(pose: Pose) -> Float[np.ndarray, " 2"]:
    return np.array([pose.x, pose.y])
