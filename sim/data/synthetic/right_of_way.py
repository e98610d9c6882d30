"""Decides who waits where: at lines, before crosswalks and where ways meet."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .courses import Courses
from .drivers import Drivers
from .network import Network

COMFORT = 3.2  # a driver who would need more braking [m/s^2] goes on
HORIZON = 9.0  # seconds ahead in which others claim a zone
MARGIN = 1.0  # seconds between one car's leaving a zone and another's coming in
PULL = 1.3  # metres per second squared with which drivers expect to speed up
UNDER_WAY = 1e3  # seconds: more than any turn at a sign
HOLD_GAP = 0.3  # metres before a zone that a car may come to rest


@dataclasses.dataclass(frozen=True, kw_only=True)
class Claims:
    """Who wants each zone side when; the last entry belongs to no zone."""

    is_occupied: Bool[np.ndarray, " sides_plus_1"]
    first_in: Float[np.ndarray, " sides_plus_1"]  # seconds until somebody comes in
    first_out: Float[np.ndarray, " sides_plus_1"]  # seconds until that one is out
    turn: Float[np.ndarray, " sides_plus_1"]  # the least of the drivers' turns


def travel_time(
    distance: Float[np.ndarray, "drivers places"],
    speed: Float[np.ndarray, " drivers"],
    allowed: Float[np.ndarray, " drivers"],
) -> Float[np.ndarray, "drivers places"]:
    """Returns when drivers expect to be so far on, speeding up where they may [s]."""
    v = speed[:, None]
    distance = np.maximum(distance, 0.0)
    last = np.sqrt(v * v + 2 * PULL * distance)
    last = np.minimum(last, np.maximum(speed, allowed)[:, None])
    return 2 * distance / (v + last + 0.1)


def waits_for_others(
    courses: Courses,
    network: Network,
    drivers: Drivers,
    station: Float[np.ndarray, " drivers"],
    speed: Float[np.ndarray, " drivers"],
    turn: Float[np.ndarray, " drivers"],
    is_held: Bool[np.ndarray, " drivers"],
) -> Float[np.ndarray, " drivers"]:
    """Returns how far ahead each driver must stop for others, or infinity [m].

    One gives way to whoever is inside a zone, to those with priority whose time in it
    would overlap the own one, and among equals to who came first.

    Args:
        courses: the ways of the drivers.
        network: the town.
        drivers: their sizes.
        station: where they are [m].
        speed: their speeds [m/s].
        turn: when each came to the sign at which it stands [steps]; infinite for all
            others. Among equals the least goes.
        is_held: by a red light, a sign or the end of its way; such drivers claim
            nothing that lies beyond.
    """
    half = drivers.size[:, 0] / 2
    to_begin = courses.zone_begin - (station + half)[:, None]
    to_end = courses.zone_end - (station - half)[:, None]
    is_inside = (to_begin < 0) & (to_end > 0)
    is_ahead = to_begin >= 0
    cells = np.minimum(station.astype(int), courses.allowed.shape[1] - 1)
    allowed = courses.allowed[np.arange(len(speed)), np.maximum(cells, 0)]
    time_in = travel_time(to_begin, speed, allowed)
    time_out = travel_time(to_end, speed, allowed)
    claims = is_ahead & (time_in < HORIZON) & ~is_held[:, None]
    # Those at a sign go in turn, after all who are under way.
    order = np.where(turn[:, None] < np.inf, turn[:, None], time_in - UNDER_WAY)

    others = _claims(
        courses.side,
        len(network.zones.lane),
        is_inside,
        (
            np.where(claims, time_in, np.inf),
            np.where(claims, time_out, np.inf),
            np.where(claims, order, np.inf),
        ),
    )
    other = courses.side ^ 1
    other = np.where(courses.side == len(network.zones.lane), courses.side, other)
    yields = np.append(network.zones.yields, -1)[courses.side]
    comes = (others.first_in[other] < time_out + MARGIN) & (
        others.first_out[other] > time_in - MARGIN
    )
    is_later = others.turn[other] < order
    gives_way = others.is_occupied[other] | ((yields > 0) & comes)
    gives_way |= (yields == 0) & comes & is_later
    hold = np.where(
        courses.zone_hold >= (station + half)[:, None],
        courses.zone_hold,
        courses.zone_begin - HOLD_GAP,
    )
    return nearest_wall(hold - (station + half)[:, None], is_ahead & gives_way, speed)


def nearest_wall(
    distance: Float[np.ndarray, "drivers places"],
    is_closed: Bool[np.ndarray, "drivers places"],
    speed: Float[np.ndarray, " drivers"],
) -> Float[np.ndarray, " drivers"]:
    """Returns the nearest closed place at which a driver can stop, or infinity [m]."""
    enough = (speed * speed / (2 * COMFORT))[:, None]
    walls = np.where(is_closed & (distance >= enough), distance, np.inf)
    return walls.min(axis=1)


def _claims(
    side: Int[np.ndarray, "drivers places"],
    num_sides: int,
    is_inside: Bool[np.ndarray, "drivers places"],
    times: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> Claims:
    """Gathers by zone side what its drivers claim."""
    occupied = np.zeros(num_sides + 1, bool)
    occupied[side[is_inside]] = True
    occupied[-1] = False
    least = []
    for values in times:
        table = np.full(num_sides + 1, np.inf)
        np.minimum.at(table, side, values)
        table[-1] = np.inf
        least.append(table)
    return Claims(
        is_occupied=occupied, first_in=least[0], first_out=least[1], turn=least[2]
    )
