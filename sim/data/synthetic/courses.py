"""Lays out the way of each driver: its lanes, and the stations of all rules on them."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from .conflicts import Zones
from .junction import CROSSWALK
from .network import CELL, NO_LIGHT, Network

LANES, LINES, SIDES, WALKS = 12, 5, 48, 10  # of one course, at most
DIVERGED = 10.0  # metres after which a car that turned off is out of the way
EASE = 1.4  # metres per second squared of braking ahead of a bend
SLOWEST = 2.5  # metres per second, that any bend allows
BEFORE_WALK = 2.2  # metres from the middle of a crosswalk to where cars wait
NEVER = np.inf


@dataclasses.dataclass(frozen=True, kw_only=True)
class Courses:
    """The ways of all drivers, one a row, in metres from where the way begins.

    Rows are written anew, in place, when their driver changes lanes.
    """

    lane: Int[np.ndarray, "drivers lanes"]
    begin: Float[np.ndarray, "drivers lanes"]  # infinite after the last lane
    end: Float[np.ndarray, " drivers"]  # of the whole way
    entry: Float[np.ndarray, "drivers town_lanes"]  # where any lane begins, or NaN
    reach: Float[np.ndarray, "drivers town_lanes"]  # how far into it others matter
    allowed: Float[np.ndarray, "drivers cells"]  # speed [m/s]
    line: Float[np.ndarray, "drivers lines"]  # stop lines, infinite after the last
    line_lane: Int[np.ndarray, "drivers lines"]
    side: Int[np.ndarray, "drivers sides"]  # of the zones of `Network`, or the last
    zone_begin: Float[np.ndarray, "drivers sides"]  # infinite after the last
    zone_end: Float[np.ndarray, "drivers sides"]
    zone_hold: Float[np.ndarray, "drivers sides"]  # where to wait for the others
    walk: Int[np.ndarray, "drivers walks"]  # crosswalk passages, or the last
    walk_hold: Float[np.ndarray, "drivers walks"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rules:
    """What is on each lane, for laying out courses quickly."""

    network: Network
    sides: dict[int, list[int]]  # of zones, by lane
    walks: dict[int, list[tuple[int, float]]]  # passages and their stations, by lane
    walk_point: Float[np.ndarray, "walks 2"]  # where each passage is
    walk_crossing: tuple[tuple[int, int], ...]  # piece and crossing of each


def rules(network: Network) -> Rules:
    """Gathers zones and crosswalks by lane."""
    sides: dict[int, list[int]] = {}
    for side, lane in enumerate(network.zones.lane.tolist()):
        sides.setdefault(lane, []).append(side)
    walks: dict[int, list[tuple[int, float]]] = {}
    points, owners = [], []
    middle = sum(CROSSWALK) / 2
    town = network.town
    for number, piece in enumerate(town.pieces):
        base = int(town.first_lane[number])
        for arm in range(len(piece.crossings)):
            port = piece.ports[arm]
            passages = [(lane, middle) for lane in port.begins]
            passages += [
                (lane, network.length[base + lane] - middle) for lane in port.ends
            ]
            for lane, station in passages:
                walks.setdefault(base + lane, []).append((len(points), station))
                line = piece.lanes[lane].line
                at = min(int(station / 0.8), len(line) - 1)
                points.append(line[at])
                owners.append((number, arm))
    return Rules(
        network=network,
        sides=sides,
        walks=walks,
        walk_point=np.array(points).reshape(-1, 2),
        walk_crossing=tuple(owners),
    )


def empty(rules: Rules, num_drivers: int, num_cells: int) -> Courses:
    """Returns rows without any way."""
    num_lanes, num_sides = len(rules.network.length), len(rules.network.zones.lane)

    def never(width: int) -> np.ndarray:
        return np.full((num_drivers, width), NEVER)

    return Courses(
        lane=np.zeros((num_drivers, LANES), int),
        begin=never(LANES),
        end=np.zeros(num_drivers),
        entry=np.full((num_drivers, num_lanes), np.nan),
        reach=never(num_lanes),
        allowed=np.zeros((num_drivers, num_cells)),
        line=never(LINES),
        line_lane=np.zeros((num_drivers, LINES), int),
        side=np.full((num_drivers, SIDES), num_sides),
        zone_begin=never(SIDES),
        zone_end=never(SIDES),
        zone_hold=never(SIDES),
        walk=np.full((num_drivers, WALKS), len(rules.walk_point)),
        walk_hold=never(WALKS),
    )


def follow(
    generator: np.random.Generator, network: Network, lane: int, length: float
) -> tuple[int, ...]:
    """Draws a way that begins with a lane and is so long [m], or ends with the town."""
    way = [lane]
    total = network.length[lane]
    while total < length and len(way) < LANES:
        choices = [n for n in network.successors.get(way[-1], ()) if n not in way]
        if not choices:
            break
        way.append(choices[int(generator.integers(len(choices)))])
        total += network.length[way[-1]]
    return tuple(way)


def lay(
    courses: Courses,
    rules: Rules,
    row: int,
    way: tuple[int, ...],
    manner: tuple[float, float, float],
) -> None:
    """Writes the row of a driver that goes along some lanes.

    Args:
        courses: where to write.
        rules: what is on the lanes.
        row: of the driver.
        way: the lanes.
        manner: speed as a share of the limit, acceleration aside [m/s^2] and top
            speed [m/s].
    """
    network = rules.network
    begin = np.cumsum([0.0, *network.length[list(way)]])
    courses.lane[row, : len(way)] = way
    courses.lane[row, len(way) :] = way[-1]
    courses.begin[row] = NEVER
    courses.begin[row, : len(way)] = begin[:-1]
    courses.end[row] = begin[-1]
    courses.entry[row] = np.nan
    courses.reach[row] = NEVER
    for place, lane in enumerate(way):
        for other in network.successors.get(lane, ()):
            courses.entry[row, other] = begin[place + 1]
            courses.reach[row, other] = DIVERGED
    courses.entry[row, list(way)] = begin[:-1]
    courses.reach[row, list(way)] = NEVER
    courses.allowed[row] = _allowed(network, way, manner, courses.allowed.shape[1])
    _lay_lines(courses, network, row, way, begin)
    _lay_zones(courses, rules, row, way, begin)


def _lay_lines(
    courses: Courses,
    network: Network,
    row: int,
    way: tuple[int, ...],
    begin: Float[np.ndarray, " ends"],
) -> None:
    found = [
        (begin[place], lane)
        for place, lane in enumerate(way)
        if network.stops[lane] or network.light[lane] != NO_LIGHT
    ][:LINES]
    courses.line[row] = NEVER
    for column, (station, lane) in enumerate(found):
        courses.line[row, column] = station
        courses.line_lane[row, column] = lane


def _lay_zones(
    courses: Courses,
    rules: Rules,
    row: int,
    way: tuple[int, ...],
    begin: Float[np.ndarray, " ends"],
) -> None:
    zones: Zones = rules.network.zones
    courses.side[row] = len(zones.lane)
    courses.walk[row] = len(rules.walk_point)
    for table in (courses.zone_begin, courses.zone_end, courses.zone_hold):
        table[row] = NEVER
    courses.walk_hold[row] = NEVER
    column = walks = 0
    for place, lane in enumerate(way):
        start = begin[place]
        for side in rules.sides.get(lane, ())[: SIDES - column]:
            courses.side[row, column] = side
            courses.zone_begin[row, column] = start + zones.begin[side]
            courses.zone_end[row, column] = start + zones.end[side]
            is_merge = zones.begin[side] > 30.0
            hold = start + zones.begin[side] if is_merge else start
            courses.zone_hold[row, column] = hold
            column += 1
        for passage, station in rules.walks.get(lane, ())[: WALKS - walks]:
            courses.walk[row, walks] = passage
            courses.walk_hold[row, walks] = start + station - BEFORE_WALK
            walks += 1


def _allowed(
    network: Network,
    way: tuple[int, ...],
    manner: tuple[float, float, float],
    num_cells: int,
) -> Float[np.ndarray, " cells"]:
    """Returns the speed at each metre from which limits and bends ahead are kept.

    Braking at a constant rate e keeps v^2 + 2 e s: its least value is passed backwards.
    """
    share, aside, top = manner
    bent = np.concatenate([network.curvature[lane] for lane in way])[:num_cells]
    limit = np.concatenate(
        [np.full(len(network.curvature[lane]), network.limit[lane]) for lane in way]
    )[:num_cells]
    missing = num_cells - len(bent)
    bent = np.concatenate([bent, np.full(missing, bent[-1])])
    limit = np.concatenate([limit, np.full(missing, limit[-1])])
    fastest = np.minimum(share * limit, top)
    energy = np.maximum(aside / np.maximum(bent, 1e-4), SLOWEST**2)
    energy = np.minimum(energy, fastest**2) + 2 * EASE * CELL * np.arange(num_cells)
    energy = np.minimum.accumulate(energy[::-1])[::-1]
    return np.sqrt(energy - 2 * EASE * CELL * np.arange(num_cells))
