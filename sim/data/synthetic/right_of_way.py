"""Decides who waits where: at lines, before crosswalks and where ways meet."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from .courses import Courses
from .drivers import Drivers

COMFORT = 3.2  # a driver who would need more braking [m/s^2] goes on
HORIZON = 9.0  # seconds ahead in which others claim a zone
MARGIN = 1.0  # seconds between one car's leaving a zone and another's coming in
PULL = 1.3  # metres per second squared with which drivers expect to speed up
REACH = 12.0  # metres ahead in which even those who stand claim zones
UNDER_WAY = 1e3  # seconds: more than any turn at a sign
HOLD_GAP = 0.3  # metres before a zone that a car may come to rest


@dataclasses.dataclass(frozen=True, kw_only=True)
class Claims:
    """Who wants each zone side when."""

    is_occupied: Bool[np.ndarray, " sides"]
    first_in: Float[np.ndarray, " sides"]  # seconds until somebody comes in
    first_out: Float[np.ndarray, " sides"]  # seconds until that one is out
    turn: Float[np.ndarray, " sides"]  # the least of the drivers' turns


@dataclasses.dataclass(frozen=True, kw_only=True)
class Meetings:
    """Which drivers come to which zones soon; one row for a driver and a zone."""

    driver: Int[np.ndarray, " meetings"]
    side: Int[np.ndarray, " meetings"]  # of the zone
    to_begin: Float[np.ndarray, " meetings"]  # metres, negative for who is inside
    to_end: Float[np.ndarray, " meetings"]
    to_hold: Float[np.ndarray, " meetings"]  # metres to where one would wait
    time_in: Float[np.ndarray, " meetings"]  # seconds
    time_out: Float[np.ndarray, " meetings"]
    turn: Float[np.ndarray, " meetings"]  # among equals the least goes


def travel_time(
    distance: Float[np.ndarray, " places"],
    speed: Float[np.ndarray, " places"],
    allowed: Float[np.ndarray, " places"],
) -> Float[np.ndarray, " places"]:
    """Returns when drivers expect to be so far on, speeding up where they may [s]."""
    distance = np.maximum(distance, 0.0)
    last = np.sqrt(speed * speed + 2 * PULL * distance)
    last = np.minimum(last, np.maximum(speed, allowed))
    return 2 * distance / (speed + last + 0.1)


def meetings(
    courses: Courses,
    drivers: Drivers,
    station: Float[np.ndarray, " drivers"],
    speed: Float[np.ndarray, " drivers"],
    turn: Float[np.ndarray, " drivers"],
) -> Meetings:
    """Finds the zones that drivers are in or will be in before long.

    Args:
        courses: the ways of the drivers.
        drivers: their sizes.
        station: where they are [m].
        speed: their speeds [m/s].
        turn: when each came to the sign at which it stands [steps], or infinite.
    """
    half = drivers.size[:, 0] / 2
    front, rear = station + half, station - half
    reach = front + REACH + HORIZON * speed
    soon = (courses.zone_begin < reach[:, None]) & (courses.zone_end > rear[:, None])
    driver, column = np.nonzero(soon)
    begin = courses.zone_begin[driver, column] - front[driver]
    hold = courses.zone_hold[driver, column] - front[driver]
    end = courses.zone_end[driver, column] - rear[driver]
    cells = np.clip(station.astype(int), 0, courses.allowed.shape[1] - 1)
    allowed = courses.allowed[np.arange(len(speed)), cells]
    v, allowed = speed[driver], allowed[driver]
    time_in = travel_time(begin, v, allowed)
    # Those at a sign go in turn, after all who are under way.
    at_sign = turn[driver] < np.inf
    return Meetings(
        driver=driver,
        side=courses.side[driver, column],
        to_begin=begin,
        to_end=end,
        to_hold=np.where(hold >= 0, hold, begin - HOLD_GAP),
        time_in=time_in,
        time_out=travel_time(end, v, allowed),
        turn=np.where(at_sign, turn[driver], time_in - UNDER_WAY),
    )


def waits_for_others(
    meeting: Meetings,
    yields: Int[np.ndarray, " sides"],
    speed: Float[np.ndarray, " drivers"],
    is_held: Bool[np.ndarray, " drivers"],
) -> Float[np.ndarray, " drivers"]:
    """Returns how far ahead each driver must stop for others, or infinity [m].

    One gives way to whoever is inside a zone, to those with priority whose time in it
    would overlap the own one, and among equals to who came first.

    Args:
        meeting: who comes to which zones.
        yields: of the sides of all zones, as in `Zones`.
        speed: of the drivers [m/s].
        is_held: by a red light, a sign or the end of its way; such drivers claim
            nothing that lies beyond.
    """
    claims = (meeting.to_begin >= 0) & (meeting.time_in < HORIZON)
    claims &= ~is_held[meeting.driver]
    others = _claims(meeting, len(yields), claims)
    other = meeting.side ^ 1
    comes = (others.first_in[other] < meeting.time_out + MARGIN) & (
        others.first_out[other] > meeting.time_in - MARGIN
    )
    rank = yields[meeting.side]
    waits = others.is_occupied[other] | ((rank > 0) & comes)
    waits |= (rank == 0) & comes & (others.turn[other] < meeting.turn)
    waits &= meeting.to_begin >= 0
    waits &= meeting.to_hold >= speed[meeting.driver] ** 2 / (2 * COMFORT)
    wall = np.full(len(speed), np.inf)
    np.minimum.at(wall, meeting.driver[waits], meeting.to_hold[waits])
    return wall


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
    meeting: Meetings, num_sides: int, is_claim: Bool[np.ndarray, " meetings"]
) -> Claims:
    """Gathers by zone side what its drivers claim."""
    occupied = np.zeros(num_sides, bool)
    occupied[meeting.side[meeting.to_begin < 0]] = True
    side = meeting.side[is_claim]
    least = []
    for values in (meeting.time_in, meeting.time_out, meeting.turn):
        table = np.full(num_sides, np.inf)
        np.minimum.at(table, side, values[is_claim])
        least.append(table)
    return Claims(
        is_occupied=occupied, first_in=least[0], first_out=least[1], turn=least[2]
    )
