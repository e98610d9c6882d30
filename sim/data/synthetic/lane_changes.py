"""Changes lanes by MOBIL (Kesting, Treiber and Helbing 2007)."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from . import drivers as experts, lines
from .drivers import Drivers
from .network import Network

NONE = -1
THRESHOLD = 0.2  # metres per second squared that a change must win
SAFE = 2.5  # metres per second squared of braking that it may cost who follows
LEAST_SPEED = 3.0  # metres per second
ROOM = (10.0, 35.0)  # metres from the ends of a lane in which nobody changes
DURATION, LEAST_LENGTH = 4.0, 26.0  # seconds and metres of a change
BOTH_LANES = 0.6  # of a change in which one takes up the old lane too


@dataclasses.dataclass(frozen=True, kw_only=True)
class Changes:
    """Who is changing lanes; where nobody does, `old_lane` is -1."""

    old_lane: Int[np.ndarray, " drivers"]
    old_shift: Float[np.ndarray, " drivers"]  # station in the old lane minus own [m]
    begin: Float[np.ndarray, " drivers"]  # station where the change begins [m]
    length: Float[np.ndarray, " drivers"]  # metres along the road
    width: Float[np.ndarray, " drivers"]  # metres left of the new lane at first


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bodies:
    """Where cars take up room: each in its lane, and those that change in both."""

    lane: Int[np.ndarray, " bodies"]  # -1 where there is none
    rear: Float[np.ndarray, " bodies"]  # metres along the lane
    length: Float[np.ndarray, " bodies"]  # metres
    speed: Float[np.ndarray, " bodies"]


def none(num_drivers: int) -> Changes:
    """Returns the changes of drivers who keep their lanes."""
    zeros = np.zeros(num_drivers)
    return Changes(
        old_lane=np.full(num_drivers, NONE),
        old_shift=zeros,
        begin=zeros,
        length=zeros + 1.0,
        width=zeros,
    )


def beside(
    changes: Changes, station: Float[np.ndarray, " drivers"]
) -> tuple[Float[np.ndarray, " drivers"], Float[np.ndarray, " drivers"]]:
    """Returns how far left of its lane each driver is [m], and the slope of that.

    With the share u of the way, a width w fades as w (1 - 10 u^3 + 15 u^4 - 6 u^5).
    """
    u = np.clip((station - changes.begin) / changes.length, 0.0, 1.0)
    done = u * u * u * (10 + u * (6 * u - 15))
    rate = 30 * u * u * (1 - u) * (1 - u) / changes.length
    return changes.width * (1 - done), -changes.width * rate


def is_in_both(
    changes: Changes, station: Float[np.ndarray, " drivers"]
) -> Bool[np.ndarray, " drivers"]:
    """Tells who still takes up the lane that it leaves."""
    share = (station - changes.begin) / changes.length
    return (changes.old_lane != NONE) & (share < BOTH_LANES)


def wishes(
    network: Network,
    drivers: Drivers,
    bodies: Bodies,
    place: Float[np.ndarray, " drivers"],
    may: Bool[np.ndarray, " drivers"],
) -> list[tuple[int, int, float]]:
    """Returns who changes to which lane now, and where in it [m].

    MOBIL's incentive (eq. 6) is a~_c - a_c + p (a~_n - a_n + a~_o - a_o) > threshold,
    with the driver c, the new follower n and the old one o; a~ is the acceleration
    after the change. It is safe (eq. 4) if a~_n >= -b_safe. The first driver who wishes
    it changes, and nobody else in this step, so that two never aim at one gap.

    Args:
        network: the town.
        drivers: their manners, one for each of the first bodies.
        bodies: who is where.
        place: the station of each driver's middle in its lane [m].
        may: who is ready to change.
    """
    found = []
    for i in np.flatnonzero(may).tolist():
        lane = int(bodies.lane[i])
        for target in network.neighbors.get(lane, ()):
            share = network.length[target] / network.length[lane]
            there = float(place[i] * share)
            if not ROOM[0] < there < network.length[target] - ROOM[1]:
                continue
            if _pays(network, drivers, bodies, (i, target, there)):
                found.append((i, target, there))
                return found
    return found


def _pays(
    network: Network, drivers: Drivers, bodies: Bodies, move: tuple[int, int, float]
) -> bool:
    i, target, there = move
    half = drivers.size[i, 0] / 2
    here = float(bodies.rear[i]) + half
    old_leader, old_follower = _around(bodies, int(bodies.lane[i]), here, i)
    leader, follower = _around(bodies, target, there, i)

    def push(who: int, rear: float, ahead: int | None, front_at: float) -> float:
        """Returns the acceleration of one body behind another (IDM)."""
        driver = who % len(drivers.desired)
        one = _row(drivers, driver)
        speed = bodies.speed[who : who + 1]
        top = np.minimum(one.desired * network.limit[target], one.top_speed)
        result = experts.free(one, speed, top)
        if ahead is not None:
            gap = np.array([rear - front_at])
            closing = speed - bodies.speed[ahead]
            result = result - experts.interaction(one, speed, gap, closing)
        return float(result[0])

    def front(body: int) -> float:
        return float(bodies.rear[body] + bodies.length[body])

    def rear(body: int | None) -> float:
        return 0.0 if body is None else float(bodies.rear[body])

    gain = push(i, rear(leader), leader, there + half)
    gain -= push(i, rear(old_leader), old_leader, here + half)
    others = 0.0
    if follower is not None:
        after = push(follower, there - half, i, front(follower))
        if after < -SAFE or there - half - front(follower) < 2.0:
            return False
        others += after - push(follower, rear(leader), leader, front(follower))
    if leader is not None and rear(leader) - there - half < 2.0:
        return False
    if old_follower is not None:
        others += push(
            old_follower, rear(old_leader), old_leader, front(old_follower)
        ) - push(old_follower, here - half, i, front(old_follower))
    return gain + float(drivers.courtesy[i]) * others > THRESHOLD


def _around(
    bodies: Bodies, lane: int, middle: float, own: int
) -> tuple[int | None, int | None]:
    """Returns the bodies next ahead of a place in a lane and next behind it."""
    away = bodies.rear + bodies.length / 2 - middle
    is_here = bodies.lane == lane
    is_here[own] = False
    ahead = np.where(is_here & (away >= 0), away, np.inf)
    behind = np.where(is_here & (away < 0), -away, np.inf)
    first, last = int(np.argmin(ahead)), int(np.argmin(behind))
    return (
        first if ahead[first] < np.inf else None,
        last if behind[last] < np.inf else None,
    )


def _row(drivers: Drivers, row: int) -> Drivers:
    return Drivers(
        **{
            field.name: getattr(drivers, field.name)[row : row + 1]
            for field in dataclasses.fields(drivers)
        }
    )


def started(
    changes: Changes,
    network: Network,
    driver: int,
    lanes: tuple[int, int],
    stations: tuple[float, float],
    speed: float,
) -> Changes:
    """Returns the changes with one more begun.

    Args:
        changes: those so far.
        network: the town.
        driver: who begins.
        lanes: the old and the new one.
        stations: where it is in each [m]; the new lane is the first of its new course.
        speed: of the driver [m/s].
    """
    old, new = (network.town.lanes[lane].line for lane in lanes)
    width = _seen(new, stations[1], _at(old, stations[0]))[1]
    copies = {
        field.name: getattr(changes, field.name).copy()
        for field in dataclasses.fields(changes)
    }
    copies["old_lane"][driver] = lanes[0]
    copies["old_shift"][driver] = stations[0] - stations[1]
    copies["begin"][driver] = stations[1]
    copies["length"][driver] = max(speed * DURATION, LEAST_LENGTH)
    copies["width"][driver] = lines.snapped(width)
    return Changes(**copies)


def across(
    network: Network, lanes: tuple[int, int], stations: tuple[float, float]
) -> float:
    """Returns the station in the second lane that is just beside one in the first.

    Args:
        network: the town.
        lanes: where one is, and the lane beside it.
        stations: where one is in the first, and about where that is in the second [m].
    """
    old, new = (network.town.lanes[lane].line for lane in lanes)
    ahead, _ = _seen(new, stations[1], _at(old, stations[0]))
    return lines.snapped(stations[1] + ahead)


def _seen(
    line: lines.Line, station: float, xy: Float[np.ndarray, " 2"]
) -> tuple[float, float]:
    """Returns how far ahead and left a place is of one on a line [m]."""
    origin = _at(line, station)
    ahead = _at(line, station + 1.0) - _at(line, station - 1.0)
    ahead = ahead / np.sqrt(ahead[0] ** 2 + ahead[1] ** 2)
    gap = xy - origin
    return (
        float(ahead[0] * gap[0] + ahead[1] * gap[1]),
        float(ahead[0] * gap[1] - ahead[1] * gap[0]),
    )


def _at(line: lines.Line, station: float) -> Float[np.ndarray, " 2"]:
    places = lines.stations(line)
    return np.array([np.interp(station, places, values) for values in line.T])
