"""Makes the map of a scenario from lanes that lie between two bounds."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..scenario import LaneLinks, MapType, Polylines, ScenarioError
from . import parts, road_outline
from .lane_graph import stations

SPACING = 1.0  # metres between the points of a centre line, at most
MAX_POINTS = 500_000  # of all centre lines
SAME_PLACE = 0.01  # metres to which two lines must agree to be one


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Lane:
    """One lane as maps tell it that give its two sides."""

    lane_id: int
    kind: MapType
    left: Float[np.ndarray, "left_points 3"]  # the bound, in driving direction [m]
    right: Float[np.ndarray, "right_points 3"]
    left_line: MapType | None = None  # painted on the bound
    right_line: MapType | None = None
    successors: tuple[int, ...] = ()
    predecessors: tuple[int, ...] = ()
    neighbors: tuple[int, ...] = ()  # lanes beside it that lead the same way
    speed_limit: float = 0.0  # metres per second, 0 where there is none

    def __post_init__(self) -> None:
        """Checks the bounds.

        Raises:
            ScenarioError: if a bound has fewer than two points.
        """
        if min(len(self.left), len(self.right)) < 2:
            raise ScenarioError(
                f"lane {self.lane_id} has bounds of {len(self.left)} and "
                f"{len(self.right)} points; two are the least"
            )

    @property
    def area(self) -> Float[np.ndarray, "points 3"]:
        """What the lane covers, as a ring that is not closed."""
        return np.concatenate([self.left, self.right[::-1]])

    @property
    def centre_line(self) -> Float[np.ndarray, "points 3"]:
        """The points midway between those at equal shares of the two bounds."""
        shares = np.linspace(0.0, 1.0, self.num_points)
        return (_at(self.left, shares) + _at(self.right, shares)) / 2

    @property
    def end(self) -> Float[np.ndarray, " 3"]:
        """Where the centre line ends."""
        return (self.left[-1] + self.right[-1]) / 2

    @property
    def num_points(self) -> int:
        """How many points the centre line has.

        Raises:
            ScenarioError: if a bound reaches nowhere, or too far.
        """
        length = max(stations(self.left)[-1], stations(self.right)[-1])
        if not length < MAX_POINTS * SPACING:
            raise ScenarioError(f"lane {self.lane_id} is {length} m long")
        return int(np.ceil(length / SPACING)) + 1 if length > 0 else 2


def roads(
    lanes: Sequence[Lane],
    areas: Sequence[Float[np.ndarray, "_ 3"]],
    others: Sequence[tuple[MapType, int, Float[np.ndarray, "_ 3"]]] = (),
) -> Polylines:
    """Returns the features of a map.

    These are the centre lines under their lanes' ids, then `others`, then the painted
    lines and the road's edges under ids that no other feature has. A line that two
    lanes share comes once. The road is open where lanes lead in or out of the map.

    Args:
        lanes: of the map.
        areas: rings that together cover the road [m].
        others: kind, id and points of what else there is, as crosswalks.

    Raises:
        ScenarioError: if the lanes are too long or the areas too tangled.
    """
    total = sum(lane.num_points for lane in lanes)
    if total > MAX_POINTS:
        raise ScenarioError(
            f"the lanes are {total} m long, at most {MAX_POINTS} are read; cut the map"
        )
    features = [(lane.kind, lane.lane_id, lane.centre_line) for lane in lanes]
    features += others
    outer, islands = road_outline.edges(areas, _openings(lanes))
    nameless = _lines(lanes)
    nameless += [(MapType.EDGE_BOUNDARY, run) for run in outer]
    nameless += [(MapType.EDGE_MEDIAN, run) for run in islands]
    # No id is used twice, and none overflows: ids need not be dense.
    taken = {name for _, name, _ in features}
    free = (name for name in range(len(taken) + len(nameless)) if name not in taken)
    features += [(kind, next(free), run) for kind, run in nameless]
    if not features:
        return _no_roads()
    map_type, feature_id, points = zip(*features, strict=True)
    return parts.polylines(
        np.concatenate(points),
        np.array([len(run) for run in points]),
        np.array(map_type, np.int64),
        np.array(feature_id, np.int64),
    )


def links(lanes: Sequence[Lane], stops: Sequence[tuple[int, int]] = ()) -> LaneLinks:
    """Returns what ties the lanes to one another.

    Args:
        lanes: of the map.
        stops: a stop sign, and a lane that it stops.
    """
    successor = [(lane.lane_id, name) for lane in lanes for name in lane.successors]
    successor += [(name, lane.lane_id) for lane in lanes for name in lane.predecessors]
    return parts.lane_links(
        successor,
        [(lane.lane_id, name) for lane in lanes for name in lane.neighbors],
        stops,
        {lane.lane_id: lane.speed_limit for lane in lanes},
    )


def _at(
    bound: Float[np.ndarray, "points 3"], shares: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, "samples 3"]:
    """Returns the points at shares of a bound's length."""
    station = stations(bound)
    along = shares * station[-1]
    return np.stack([np.interp(along, station, axis) for axis in bound.T], axis=-1)


def _openings(lanes: Sequence[Lane]) -> list[Float[np.ndarray, "2 3"]]:
    """Returns lines across the lanes where they lead in or out of the map."""
    known = {lane.lane_id for lane in lanes}
    followed = {name for lane in lanes for name in lane.predecessors}
    preceded = {name for lane in lanes for name in lane.successors}
    found = []
    for lane in lanes:
        if lane.lane_id not in preceded and not known.intersection(lane.predecessors):
            found.append(np.stack([lane.left[0], lane.right[0]]))
        if lane.lane_id not in followed and not known.intersection(lane.successors):
            found.append(np.stack([lane.left[-1], lane.right[-1]]))
    return found


def _lines(lanes: Sequence[Lane]) -> list[tuple[MapType, Float[np.ndarray, "_ 3"]]]:
    """Returns the painted lines, each once: lanes side by side both tell of theirs."""
    found = {}
    for lane in lanes:
        for kind, bound in (
            (lane.left_line, lane.left),
            (lane.right_line, lane.right),
        ):
            if kind is not None:
                way = np.round(bound / SAME_PLACE)
                place = min(way.tobytes(), way[::-1].tobytes())
                found.setdefault(place, (kind, bound))
    return list(found.values())


def _no_roads() -> Polylines:
    nothing = np.zeros(0, np.int64)
    return Polylines(
        xyz=np.zeros((0, 3)),
        offset=np.zeros(1, np.int64),
        map_type=nothing,
        feature_id=nothing,
    )
