"""Decides who is in a town and where everybody begins."""

import dataclasses

import numpy as np

from ...scenario import MapType
from . import courses as ways, drivers as experts, lines
from .courses import Rules
from .drivers import Drivers
from .network import NO_LIGHT
from .signals import goes
from .traffic import Start

SPACING = (12.0, 90.0)  # metres from car to car, the mean of a scenario
LEAST_SPACING = 4.0  # metres between cars, besides the length of one
LONGEST = 12.0  # metres of a car at most
QUEUE = 7.6  # metres from one waiting car to the next
FIRST_WAITING = 4.0  # metres from a stop line to the first one's middle
SHARE_OF_CYCLISTS = 0.06
CAR_PARK_SHARE = 0.3  # of the cars that a road of that length would have
FREEWAY_SHARE = 2.5  # of the spacing on streets, as all are faster
MAX_DRIVERS = 70
BRAKING = 1.5  # metres per second squared that the first speeds leave before a line
NEAR = 150.0  # metres from the origin, within which drivers begin
SECONDS = 15.0  # for which a way must suffice


@dataclasses.dataclass(frozen=True)
class _Slot:
    lane: int
    station: float
    waits: bool


def people(generator: np.random.Generator, rules: Rules) -> tuple[Drivers, Start]:
    """Draws drivers along all roads, queues where lights are red, and their ways."""
    mean = SPACING[0] * (SPACING[1] / SPACING[0]) ** generator.uniform()
    queue = int(generator.integers(1, 7))
    slots = _slots(generator, rules, mean, queue)
    network = rules.network
    is_cyclist = generator.uniform(size=len(slots)) < SHARE_OF_CYCLISTS
    is_cyclist &= np.array([_is_outer(rules, slot) for slot in slots], bool)
    drivers = experts.draw(generator, is_cyclist)
    runs, speeds = [], []
    for row, slot in enumerate(slots):
        fastest = min(1.15 * network.limit[slot.lane], drivers.top_speed[row])
        length = slot.station + SECONDS * fastest + 30.0
        runs.append(ways.follow(generator, network, slot.lane, length))
        speeds.append(_speed(rules, drivers, row, slot, slots))
    return drivers, Start(
        ways=tuple(runs),
        station=np.array([slot.station for slot in slots]),
        speed=np.array(speeds),
    )


def _slots(
    generator: np.random.Generator, rules: Rules, mean: float, queue: int
) -> list[_Slot]:
    """Returns places in all lanes of roads, from their ends backwards."""
    network = rules.network
    town = network.town
    found: list[_Slot] = []
    starts_green = goes(network.light_state[:, 0])
    quiet = {
        int(town.first_lane[number]) + lane
        for number, piece in enumerate(town.pieces)
        if piece.kind == "carpark"
        for lane in range(len(piece.lanes))
    }
    for lane, of_town in enumerate(town.lanes):
        if of_town.turn is not None or not network.is_driven[lane]:
            continue
        spacing = mean / CAR_PARK_SHARE if lane in quiet else mean
        if of_town.map_type == MapType.LANE_FREEWAY:
            spacing *= FREEWAY_SHARE
        spacing *= generator.uniform(0.6, 1.6)
        station = float(network.length[lane])
        is_red = any(
            network.light[after] != NO_LIGHT and not starts_green[network.light[after]]
            for after in network.successors.get(lane, ())
        )
        if is_red:
            station -= FIRST_WAITING
            for _ in range(int(generator.integers(0, queue + 1))):
                if station > FIRST_WAITING:
                    found.append(_Slot(lane, station, True))
                station -= QUEUE + generator.uniform(0.0, 1.0)
        station -= generator.uniform(0.2, 1.0) * spacing
        while station > FIRST_WAITING:
            found.append(_Slot(lane, station, False))
            station -= LEAST_SPACING + 5.0 + generator.exponential(spacing)
    kept = [slot for slot in found if _distance(rules, slot) < NEAR]
    kept.sort(key=lambda slot: _distance(rules, slot) * (1.0 - 0.7 * slot.waits))
    return kept[:MAX_DRIVERS]


def _is_outer(rules: Rules, slot: _Slot) -> bool:
    """Tells if a slot is in the outer lane, in traffic that moves."""
    neighbors = rules.network.neighbors.get(slot.lane, ())
    return slot.lane + 1 not in neighbors and not slot.waits


def _distance(rules: Rules, slot: _Slot) -> float:
    """Returns how far a slot lies from the origin, to a metre or so."""
    line = rules.network.town.lanes[slot.lane].line
    x, y = line[min(round(slot.station / lines.STEP), len(line) - 1)]
    return float(np.sqrt(x * x + y * y))


def _speed(
    rules: Rules, drivers: Drivers, row: int, slot: _Slot, slots: list[_Slot]
) -> float:
    """Returns a speed that the driver can keep for a moment."""
    if slot.waits:
        return 0.0
    network = rules.network
    ahead = [
        other.station - slot.station - LONGEST
        for other in slots
        if other.lane == slot.lane and other.station > slot.station
    ]
    speed = 0.9 * min(
        drivers.desired[row] * network.limit[slot.lane], drivers.top_speed[row]
    )
    if ahead:
        speed = min(speed, max(min(ahead), 0.0) / drivers.headway[row])
    to_end = max(network.length[slot.lane] - slot.station - 4.0, 0.0)
    ends_at_rule = any(
        network.stops[n] or network.light[n] != NO_LIGHT
        for n in network.successors.get(slot.lane, ())
    )
    if ends_at_rule:
        speed = min(speed, float(np.sqrt(2 * BRAKING * to_end)))
    return float(speed)
