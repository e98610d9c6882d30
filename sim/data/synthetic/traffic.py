"""Drives all cars and bicycles of a town together, step by step.

The experts keep their lane, follow the car ahead, slow down for bends, obey lights and
signs and give way. Stations and speeds are put on a grid at each step.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...scenario import DT
from . import (
    courses as ways,
    drivers as experts,
    lane_changes,
    leaders,
    right_of_way,
)
from .courses import Courses, Rules
from .drivers import HARDEST, LINE_GAP, Drivers
from .lane_changes import Changes
from .lines import snap

NOISE, NOISE_MEMORY = 0.12, 0.95  # metres per second squared; correlation of two steps
START_ROOM = 1.5  # metres that must open up before one who stands sets off
STANDS = 0.3  # metres per second
LEAST = 0.02  # metres per second: who would be slower stands
AT_SIGN = 3.5  # metres from a stop line within which a car has come to it
PAUSE = 2  # looks for which drivers stand at a stop sign
LOOK = 3  # steps from one look around to the next
CHOICE = 6  # steps between the moments at which somebody may change lanes
PATIENCE = 0.15  # chance of a driver to think of it at such a moment


@dataclasses.dataclass(frozen=True, kw_only=True)
class State:
    """Where all drivers are at one step."""

    station: Float[np.ndarray, " drivers"]  # metres along their courses
    speed: Float[np.ndarray, " drivers"]  # metres per second
    acceleration: Float[np.ndarray, " drivers"]  # metres per second squared
    line: Int[np.ndarray, " drivers"]  # stop lines that lie behind
    commits: Bool[np.ndarray, " drivers"]  # goes on although its light turns red
    stood: Int[np.ndarray, " drivers"]  # looks at the sign ahead
    turn: Float[np.ndarray, " drivers"]  # step at which it came there, or infinite
    changes: Changes
    wall: Float[np.ndarray, " drivers"]  # metres to where each must stop, or infinite
    gap: Float[np.ndarray, " drivers"]  # metres to the leader, or infinite
    leader_speed: Float[np.ndarray, " drivers"]  # metres per second
    desired: Float[np.ndarray, " drivers"]  # metres per second


@dataclasses.dataclass(frozen=True, kw_only=True)
class Drive:
    """What the drivers did, step by step."""

    ways: tuple[tuple[int, ...], ...]  # runs of lanes
    way: Int[np.ndarray, "steps drivers"]  # which of them each is on
    station: Float[np.ndarray, "steps drivers"]  # along it [m]
    speed: Float[np.ndarray, "steps drivers"]
    left: Float[np.ndarray, "steps drivers"]  # metres beside it, in lane changes
    slope: Float[np.ndarray, "steps drivers"]  # of that, along the way
    is_there: Bool[np.ndarray, "steps drivers"]  # not yet at the end of its way


@dataclasses.dataclass(frozen=True, kw_only=True)
class Start:
    """Where the drivers begin."""

    ways: tuple[tuple[int, ...], ...]  # of each driver
    station: Float[np.ndarray, " drivers"]  # metres along its way
    speed: Float[np.ndarray, " drivers"]


def drive(
    generator: np.random.Generator,
    rules: Rules,
    drivers: Drivers,
    start: Start,
    is_walked: Bool[np.ndarray, "steps walks_plus_1"],
) -> Drive:
    """Drives for as many steps as the lights run.

    Args:
        generator: draws noise, lane changes and the ways after them.
        rules: the town and its rules.
        drivers: their manners.
        start: their beginnings.
        is_walked: where pedestrians are on or near the passages of crosswalks.
    """
    num, num_steps = len(start.station), len(is_walked)
    longest = max(rules.network.length[list(way)].sum() for way in start.ways)
    courses = ways.empty(rules, num, int(longest + 250.0))
    for row, way in enumerate(start.ways):
        ways.lay(courses, rules, row, way, manner(drivers, row))
    shocks = generator.normal(size=(num_steps, num))
    shocks *= NOISE * np.sqrt(1 - NOISE_MEMORY**2)
    thinks = generator.uniform(size=(num_steps, num)) < PATIENCE
    noise = np.zeros(num)
    names, current = list(start.ways), np.arange(num)
    state = _first(start, courses)
    logged = [_logged(state, current, courses, drivers)]
    for t in range(1, num_steps):
        if t > 1 and t % CHOICE == 1:
            state = _choose(
                generator, rules, drivers, courses, state, thinks[t], (names, current)
            )
        if t % LOOK == 1:
            state = _look(rules, drivers, courses, state, is_walked[t - 1], t - 1)
        noise = snap(NOISE_MEMORY * noise + shocks[t])
        state = _step(drivers, courses, state, noise)
        logged.append(_logged(state, current, courses, drivers))
    columns = [np.stack(values) for values in zip(*logged, strict=True)]
    return Drive(
        ways=tuple(names),
        way=columns[0],
        station=columns[1],
        speed=columns[2],
        left=columns[3],
        slope=columns[4],
        is_there=columns[5],
    )


def manner(drivers: Drivers, row: int) -> tuple[float, float, float]:
    """Returns what of a driver's manner its allowed speeds depend on."""
    return (
        float(drivers.desired[row]),
        float(drivers.aside[row]),
        float(drivers.top_speed[row]),
    )


def _first(start: Start, courses: Courses) -> State:
    """Returns the state at first, with nobody faster than the bends ahead allow."""
    num = len(start.station)
    allowed = courses.allowed[np.arange(num), start.station.astype(int)]
    return State(
        station=snap(start.station),
        speed=snap(np.minimum(start.speed, allowed)),
        acceleration=np.zeros(num),
        line=np.full(num, -1),
        commits=np.zeros(num, bool),
        stood=np.zeros(num, int),
        turn=np.full(num, np.inf),
        changes=lane_changes.none(num),
        wall=np.full(num, np.inf),
        gap=np.full(num, np.inf),
        leader_speed=np.zeros(num),
        desired=np.ones(num),
    )


def _logged(
    state: State, way: np.ndarray, courses: Courses, drivers: Drivers
) -> tuple[np.ndarray, ...]:
    """Returns the columns of a `Drive` at one step."""
    left, slope = lane_changes.beside(state.changes, state.station)
    is_there = state.station + drivers.size[:, 0] / 2 < courses.end
    return way.copy(), state.station, state.speed, left, slope, is_there


def _look(
    rules: Rules,
    drivers: Drivers,
    courses: Courses,
    state: State,
    is_walked: Bool[np.ndarray, " walks_plus_1"],
    t: int,
) -> State:
    """Lets everybody see, at step t, whom to follow and where to stop."""
    speed, station = state.speed, state.station
    state, to_line, closed = _at_line(rules, drivers, courses, state, t)
    front = station + drivers.size[:, 0] / 2
    gone = front >= courses.end

    walks = is_walked[courses.walk]
    wall = right_of_way.nearest_wall(courses.walk_hold - front[:, None], walks, speed)
    wall = np.minimum(wall, np.where(closed, to_line, np.inf))
    meeting = right_of_way.meetings(courses, drivers, station, speed, state.turn)
    others = right_of_way.waits_for_others(
        meeting, rules.network.zones.yields, speed, closed | gone
    )
    bodies = leaders.bodies_of(
        courses, drivers.size[:, 0], station, speed, state.changes
    )
    gap, leader_speed = leaders.nearest(courses, bodies, front, drivers.size[:, 0])
    limit = rules.network.limit[bodies.lane[: len(speed)]]
    desired = np.minimum(drivers.desired * limit, drivers.top_speed)
    return dataclasses.replace(
        state,
        wall=np.minimum(wall, others),
        gap=gap,
        leader_speed=leader_speed,
        desired=desired,
    )


def _step(
    drivers: Drivers,
    courses: Courses,
    state: State,
    noise: Float[np.ndarray, " drivers"],
) -> State:
    """Advances everybody by one step, by what they saw last.

    A foot follows what IDM wants with a lag of first order, the reaction time.
    """
    speed, station, gap, wall = state.speed, state.station, state.gap, state.wall
    pull = experts.free(drivers, speed, state.desired)
    push = np.maximum(
        experts.interaction(drivers, speed, gap, speed - state.leader_speed),
        experts.halt(drivers, speed, wall),
    )
    wanted = np.maximum(pull - push, -HARDEST) + noise * np.minimum(speed / 2, 1.0)
    change = (wanted - state.acceleration) * np.minimum(DT / drivers.reaction, 1.0)
    acceleration = state.acceleration + change
    room = np.minimum(gap - drivers.standstill, wall - LINE_GAP)
    acceleration[(speed == 0) & (room < START_ROOM)] = 0.0
    cells = np.minimum((station + speed * DT).astype(int), courses.allowed.shape[1] - 1)
    allowed = courses.allowed[np.arange(len(speed)), cells]
    acceleration = np.minimum(acceleration, (allowed - speed) / DT)
    acceleration = np.maximum(acceleration, -HARDEST)
    next_speed = np.maximum(speed + acceleration * DT, 0.0)
    next_speed[next_speed < np.where(acceleration > 0, LEAST, 2 * LEAST)] = 0.0
    gone = station + drivers.size[:, 0] / 2 >= courses.end
    next_speed = np.where(gone, speed, snap(next_speed))
    travelled = (speed + next_speed) / 2 * DT
    return dataclasses.replace(
        state,
        station=snap(station + travelled),
        speed=next_speed,
        acceleration=(next_speed - speed) / DT,
        gap=np.maximum(gap + state.leader_speed * DT - travelled, leaders.LEAST_GAP),
        wall=wall - travelled,
    )


def _at_line(
    rules: Rules, drivers: Drivers, courses: Courses, state: State, t: int
) -> tuple[State, Float[np.ndarray, " drivers"], Bool[np.ndarray, " drivers"]]:
    """Returns the state as to the next line, its distance, and if it is closed.

    It is closed by a red light, by a yellow one before which one can stop, and by a
    sign until one has stood there.
    """
    network = rules.network
    rows = np.arange(len(state.station))
    front = state.station + drivers.size[:, 0] / 2
    line = np.sum(courses.line <= front[:, None], axis=1)
    column = np.minimum(line, courses.line.shape[1] - 1)
    to_line = courses.line[rows, column] - front
    lane = courses.line_lane[rows, column]
    is_near = to_line < np.inf
    is_new = line != state.line

    light = network.light[lane]
    too_late = to_line < state.speed**2 / (2 * right_of_way.COMFORT)
    commits = (state.commits & ~is_new) | (network.warns[light, t] & too_late)
    red = ~network.goes[light, t] & is_near & ~commits

    has_sign = network.stops[lane] & is_near
    is_at = has_sign & (to_line < AT_SIGN) & (state.speed < STANDS)
    stood = np.where(is_new, 0, state.stood) + is_at
    turn = np.where(is_new, np.inf, state.turn)
    turn = np.where(is_at & (turn == np.inf), float(t), turn)
    # Of those who came at the same step the first in the list goes.
    turn = np.where(turn == float(t), t + rows / (2.0 * len(rows)), turn)
    sign = has_sign & (stood < PAUSE)
    state = dataclasses.replace(
        state, line=line, commits=commits, stood=stood, turn=turn
    )
    return state, to_line, red | sign


def _choose(
    generator: np.random.Generator,
    rules: Rules,
    drivers: Drivers,
    courses: Courses,
    state: State,
    thinks: Bool[np.ndarray, " drivers"],
    names: tuple[list[tuple[int, ...]], Int[np.ndarray, " drivers"]],
) -> State:
    """Lets somebody change lanes; writes its new way into `courses` and `names`."""
    network = rules.network
    bodies = leaders.bodies_of(
        courses, drivers.size[:, 0], state.station, state.speed, state.changes
    )
    num = len(state.station)
    place = bodies.rear[:num] + drivers.size[:, 0] / 2
    is_done = state.station > state.changes.begin + state.changes.length
    may = thinks & ~drivers.is_cyclist & (state.speed > lane_changes.LEAST_SPEED)
    may &= (bodies.lane[:num] >= 0) & ((state.changes.old_lane < 0) | is_done)
    for driver, lane, there in lane_changes.wishes(
        network, drivers, bodies, place, may
    ):
        old = int(bodies.lane[driver])
        there = lane_changes.across(network, (old, lane), (float(place[driver]), there))
        missing = courses.end[driver] - state.station[driver]
        way = ways.follow(generator, network, lane, there + missing)
        ways.lay(courses, rules, driver, way, manner(drivers, driver))
        list_of_ways, current = names
        current[driver] = len(list_of_ways)
        list_of_ways.append(way)
        station = state.station.copy()
        station[driver] = there
        changes = lane_changes.started(
            state.changes,
            network,
            driver,
            (old, lane),
            (float(place[driver]), there),
            float(state.speed[driver]),
        )
        state = dataclasses.replace(state, station=station, changes=changes)
    return state
