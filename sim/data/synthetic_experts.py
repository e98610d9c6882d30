"""Drives the cars and cyclists of generated scenarios along their routes.

The experts keep their lane, follow the car ahead, slow down for bends and stop at red.
Each one sees only what an observation shows: its route, road, lights and others.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ..scenario import LightState
from .synthetic_roads import Line, Site

DT = 0.1  # seconds
LATERAL_ACCELERATION = 1.8  # metres per second squared in a bend, at most
EASE = 1.5  # metres per second squared of braking ahead of a bend
HARDEST = 5.0  # metres per second squared of braking, under the 6 of the bicycle
STOP_BRAKING = 3.0  # a driver who would need more at the change to yellow drives on
LINE_GAP = 1.0  # metres to the stop line at which IDM comes to rest
START_ROOM = 2.0  # metres that must open up before one who stands sets off
DIVERGED = 10.0  # metres after which a car that turned off is out of the way
NOISE, NOISE_MEMORY = 0.12, 0.95  # metres per second squared; correlation of two steps
ROUNDING = 1.0  # metres between the entries of a speed table


@dataclasses.dataclass(frozen=True, kw_only=True)
class Route:
    """A run of lanes as one smooth line."""

    lanes: tuple[int, ...]
    begin: Float[np.ndarray, " lanes"]  # station where each lane begins [m]
    station: Float[np.ndarray, " points"]  # metres
    xy: Float[np.ndarray, "points 2"]
    yaw: Float[np.ndarray, " points"]  # radians, without jumps
    curvature: Float[np.ndarray, " points"]  # 1/m


@dataclasses.dataclass(frozen=True, kw_only=True)
class Drivers:
    """Who drives where, and in which manner; the symbols are those of IDM."""

    route: Int[np.ndarray, " objects"]
    station: Float[np.ndarray, " objects"]  # metres, at step 0
    waits: Bool[np.ndarray, " objects"]  # standing in a queue at step 0
    size: Float[np.ndarray, "objects 3"]  # metres
    is_obstacle: Bool[np.ndarray, " objects"]  # False where cars can pass beside
    desired_speed: Float[np.ndarray, " objects"]  # v0
    headway: Float[np.ndarray, " objects"]  # T [s]
    acceleration: Float[np.ndarray, " objects"]  # a
    braking: Float[np.ndarray, " objects"]  # b
    standstill: Float[np.ndarray, " objects"]  # s0 [m]


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Tables:
    """What the drivers look up while they drive."""

    lane: Int[np.ndarray, "objects lanes"]  # along the own route
    begin: Float[np.ndarray, "objects lanes"]  # and where it begins, infinite after it
    entry: Float[np.ndarray, "objects site_lanes"]  # station of any lane, or NaN
    reach: Float[np.ndarray, "objects site_lanes"]  # how far into it others matter
    speed: Float[np.ndarray, "objects cells"]  # that the bends ahead allow
    stop: Float[np.ndarray, " objects"]  # station of the stop line, or infinite
    light: Int[np.ndarray, "objects steps"]


def route(lines: Sequence[Line], lanes: tuple[int, ...] = ()) -> Route:
    """Joins lines to one, each beginning where the one before ends.

    Args:
        lines: the lanes; or one line that is no lane.
        lanes: the indices of the lanes.
    """
    xy = np.concatenate([lines[0], *(line[1:] for line in lines[1:])])
    edge = np.diff(xy, axis=0)
    station = np.append(0.0, np.cumsum(np.hypot(edge[:, 0], edge[:, 1])))
    begin = np.cumsum([0, *(len(line) - 1 for line in lines[:-1])])
    # The heading of an edge is that of the curve at its middle.
    heading = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
    yaw = np.interp(station, (station[1:] + station[:-1]) / 2, heading)
    return Route(
        lanes=lanes,
        begin=station[begin],
        station=station,
        xy=xy,
        yaw=yaw,
        curvature=np.gradient(yaw, station),
    )


def drive(
    site: Site,
    routes: list[Route],
    drivers: Drivers,
    generator: np.random.Generator,
) -> tuple[Float[np.ndarray, "objects steps"], Float[np.ndarray, "objects steps"]]:
    """Returns station [m] and speed [m/s] of each driver at each step.

    The acceleration is that of IDM (Treiber et al. 2000) for the nearer of leader and
    stop line, limited by the speed that the bends ahead allow, plus slow noise.
    """
    tables = _tables(site, routes, drivers)
    num_steps = site.light_state.shape[1]
    rows = np.arange(len(drivers.station))
    passes = np.zeros(len(rows), bool)
    station, speed = drivers.station, _first_speed(tables, drivers)
    noise = np.zeros(len(rows))
    shocks = generator.normal(size=(num_steps, len(rows)))
    shocks *= NOISE * np.sqrt(1 - NOISE_MEMORY**2)
    stations, speeds = [station], [speed]
    for t in range(1, num_steps):
        light = tables.light[:, t - 1]
        to_line = tables.stop - station - drivers.size[:, 0] / 2
        turns_yellow = light == LightState.CAUTION
        if t > 1:
            turns_yellow &= tables.light[:, t - 2] == LightState.GO
        passes |= turns_yellow & (to_line < speed**2 / (2 * STOP_BRAKING))
        stops = (light != LightState.GO) & (to_line > 0) & ~passes

        gap, leader = _leaders(tables, drivers, station)
        wall = np.where(stops, to_line, np.inf)
        acceleration = _idm(drivers, speed, gap, speed[leader], wall)
        room = np.minimum(gap - drivers.standstill, wall - LINE_GAP)
        acceleration[(speed == 0) & (room < START_ROOM)] = 0.0
        noise = NOISE_MEMORY * noise + shocks[t]
        acceleration = acceleration + noise * np.minimum(speed / 2, 1.0)

        cell = (station + speed * DT) / ROUNDING
        cell = np.clip(cell.astype(int), 0, tables.speed.shape[1] - 1)
        allowed = (tables.speed[rows, cell] - speed) / DT
        acceleration = np.maximum(np.minimum(acceleration, allowed), -HARDEST)
        next_speed = np.maximum(speed + acceleration * DT, 0.0)
        station = station + (speed + next_speed) / 2 * DT
        speed = next_speed
        stations.append(station)
        speeds.append(speed)
    return np.stack(stations, axis=1), np.stack(speeds, axis=1)


def _idm(
    drivers: Drivers,
    speed: Float[np.ndarray, " objects"],
    gap: Float[np.ndarray, " objects"],
    leader_speed: Float[np.ndarray, " objects"],
    wall: Float[np.ndarray, " objects"],
) -> Float[np.ndarray, " objects"]:
    """Returns a [1 - (v/v0)^4 - (s*/s)^2], s* = s0 + vT + v dv / (2 sqrt(ab))."""
    a, b = drivers.acceleration, drivers.braking
    approach = speed / (2 * np.sqrt(a * b))
    follow = speed * drivers.headway + approach * (speed - leader_speed)
    follow = (drivers.standstill + np.maximum(follow, 0.0)) / np.maximum(gap, 0.1)
    halt = (LINE_GAP + speed + approach * speed) / np.maximum(wall, 0.1)
    free = 1 - (speed / drivers.desired_speed) ** 4
    return a * (free - np.maximum(follow, halt) ** 2)


def _leaders(
    tables: _Tables, drivers: Drivers, station: Float[np.ndarray, " objects"]
) -> tuple[Float[np.ndarray, " objects"], Int[np.ndarray, " objects"]]:
    """Returns the gap to the next one on each driver's route [m], and who it is."""
    half = drivers.size[:, 0] / 2
    rear = station - half
    place = np.maximum(np.sum(rear[:, None] >= tables.begin, axis=1) - 1, 0)
    rows = np.arange(len(station))
    lane = tables.lane[rows, place]
    in_lane = rear - tables.begin[rows, place]

    ahead = tables.entry[:, lane] + in_lane
    counts = (in_lane <= tables.reach[:, lane]) & drivers.is_obstacle
    counts &= ahead + half > station[:, None]
    counts[rows, rows] = False
    gap = np.where(counts, ahead - (station + half)[:, None], np.inf)
    leader = np.argmin(gap, axis=1)
    return gap[rows, leader], leader


def _first_speed(tables: _Tables, drivers: Drivers) -> Float[np.ndarray, " objects"]:
    """Returns speeds that all can keep for a moment: the log begins amid traffic."""
    gap, _ = _leaders(tables, drivers, drivers.station)
    rows, cell = np.arange(len(gap)), (drivers.station / ROUNDING).astype(int)
    to_line = tables.stop - drivers.station - drivers.size[:, 0] / 2 - LINE_GAP
    to_line = np.where(tables.light[:, 0] == LightState.GO, np.inf, to_line)
    to_line = np.where(to_line < -LINE_GAP, np.inf, np.maximum(to_line, 0.0))
    speed = np.minimum.reduce(
        [
            0.95 * drivers.desired_speed,
            tables.speed[rows, cell],
            np.maximum(gap - drivers.standstill, 0.0) / drivers.headway,
            np.sqrt(2 * EASE * to_line),
        ]
    )
    return np.where(drivers.waits, 0.0, speed)


def _tables(site: Site, routes: list[Route], drivers: Drivers) -> _Tables:
    num_routes, num_lanes = len(routes), len(site.lanes)
    longest = max(len(route.lanes) for route in routes)
    cells = int(max(route.station[-1] for route in routes) / ROUNDING) + 2
    lane = np.zeros((num_routes, longest), int)
    begin = np.full((num_routes, longest), np.inf)
    entry = np.full((num_routes, num_lanes), np.nan)
    reach = np.full((num_routes, num_lanes), np.inf)
    speed = np.zeros((num_routes, cells))
    stop = np.full(num_routes, np.inf)
    light = np.full((num_routes, site.light_state.shape[1]), int(LightState.GO))
    grid = ROUNDING * np.arange(cells)
    for i in np.unique(drivers.route):
        lanes, begins = routes[i].lanes, routes[i].begin
        lane[i, : len(lanes)], begin[i, : len(lanes)] = lanes, begins
        for before, after in site.successor:
            if before in lanes and after not in lanes:
                entry[i, after] = begins[lanes.index(before) + 1]
                reach[i, after] = DIVERGED
        entry[i, list(lanes)] = begins
        bent = np.interp(grid, routes[i].station, np.abs(routes[i].curvature))
        # Braking at EASE keeps v^2 + 2 EASE s: pass the least of it backwards.
        energy = LATERAL_ACCELERATION / np.maximum(bent, 1e-4) + 2 * EASE * grid
        energy = np.minimum.accumulate(energy[::-1])[::-1]
        speed[i] = np.sqrt(energy - 2 * EASE * grid)
        for name, states in zip(site.controlled, site.light_state, strict=True):
            if name in lanes:
                stop[i], light[i] = begins[lanes.index(name)], states
    of = drivers.route
    return _Tables(
        lane=lane[of],
        begin=begin[of],
        entry=entry[of],
        reach=reach[of],
        speed=speed[of],
        stop=stop[of],
        light=light[of],
    )
