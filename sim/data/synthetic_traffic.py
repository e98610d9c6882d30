"""Fills the site of a generated scenario with road users."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ..scenario import LightState, ObjectType
from . import (
    synthetic_experts as experts,
    synthetic_junction as junction,
    synthetic_steering,
)
from .synthetic_roads import FOOTWAY, Site
from .synthetic_tracks import Mover

CAR_SPACING = (11.0, 34.0)  # metres from centre to centre
PARKED_SPACING = (8.0, 30.0)  # metres from centre to centre
PARKED_SHOULDER = 2.5  # metres, at least
PARKED_SIDE = 1.15  # metres from the edge
CYCLING_SHOULDER = 1.5  # metres, at least; on narrower ones cyclists keep to the lane
SHARE_OF_CYCLISTS = 0.12
EGO_SPEED = 8.0  # metres per second that the ego desires, at least
WALKING_SPEED = (1.0, 1.6)  # metres per second
SHARE_AT_CROSSINGS = 0.6
CLEARANCE = 0.5  # metres beyond the edge at which a pedestrian has crossed


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Slots:
    """Places where drivers may begin."""

    route: Int[np.ndarray, " slots"]
    station: Float[np.ndarray, " slots"]
    waits: Bool[np.ndarray, " slots"]


def fill(site: Site, num_others: int, generator: np.random.Generator) -> list[Mover]:
    """Returns the ego, then about `num_others` others, each on its line."""
    num_walkers = int(generator.integers(0, 1 + num_others // 4))
    parked = _parked(site, num_others // 3, generator)
    num_drivers = 1 + max(num_others - num_walkers - len(parked), 3)
    return [
        *_driving(site, num_drivers, generator),
        *parked,
        *_walking(site, num_walkers, generator),
    ]


def _driving(
    site: Site, num_drivers: int, generator: np.random.Generator
) -> list[Mover]:
    routes = [
        experts.route([site.lanes[lane] for lane in lanes], lanes)
        for lanes in site.routes
    ]
    slots = _slots(site, routes, num_drivers, generator)
    num = len(slots.route)
    profile = site.profile
    outer = np.array([_is_outer(site, lanes[0]) for lanes in site.routes])[slots.route]
    is_cyclist = outer & (generator.uniform(size=num) < SHARE_OF_CYCLISTS)
    is_cyclist[0] = False
    on_shoulder = profile.shoulder > CYCLING_SHOULDER
    lane_side = profile.lane_width / 2 + (profile.shoulder / 2 if on_shoulder else -0.6)

    low = np.where(is_cyclist, 3.5, 6.0)
    low[0] = EGO_SPEED
    desired = generator.uniform(low, np.where(is_cyclist, 6.0, 16.0))
    size = _sizes(is_cyclist, generator)
    drivers = experts.Drivers(
        route=slots.route,
        station=slots.station,
        waits=slots.waits,
        size=size,
        is_obstacle=~(is_cyclist & on_shoulder),
        desired_speed=desired,
        headway=generator.uniform(1.0, 2.0, num),
        acceleration=generator.uniform(1.0, 2.0, num),
        braking=generator.uniform(1.5, 3.0, num),
        standstill=generator.uniform(1.5, 3.0, num),
    )
    station, speed = experts.drive(site, routes, drivers, generator)
    left, slope = synthetic_steering.steer(station, generator)
    left = left + np.where(is_cyclist, -lane_side, 0.0)[:, None]
    return [
        Mover(
            object_type=ObjectType.CYCLIST if is_cyclist[i] else ObjectType.VEHICLE,
            size=size[i],
            route=routes[slots.route[i]],
            station=station[i],
            speed=speed[i],
            left=left[i],
            slope=slope[i],
        )
        for i in range(num)
    ]


def _slots(
    site: Site,
    routes: list[experts.Route],
    num_slots: int,
    generator: np.random.Generator,
) -> _Slots:
    """Returns the ego's place and the others', the nearest most likely.

    Those who wait before the ego are never left out.
    """
    ego_lane = site.routes[site.ego_route][0]
    ego_xy = _at(routes[site.ego_route], site.ego_station)
    found = [(-np.inf, site.ego_route, site.ego_station, site.ego_waits)]
    for lane in sorted({lanes[0] for lanes in site.routes}):
        choices = [i for i, lanes in enumerate(site.routes) if lanes[0] == lane]
        if lane == ego_lane:
            places = _around_ego(site, _lane_length(routes[choices[0]]), generator)
        else:
            places = _along(site, routes[choices[0]], generator)
        for station, waits in places:
            choice = int(generator.choice(choices))
            away = np.linalg.norm(_at(routes[choice], station) - ego_xy)
            priority = float(away) * generator.uniform(0.2, 1.5)
            if lane == ego_lane and waits and station > site.ego_station:
                priority = -1.0
            found.append((priority, choice, station, waits))
    _, route, station, waits = zip(*sorted(found)[:num_slots], strict=True)
    return _Slots(
        route=np.array(route), station=np.array(station), waits=np.array(waits)
    )


def _around_ego(
    site: Site, lane_length: float, generator: np.random.Generator
) -> list[tuple[float, bool]]:
    """Returns places in the ego's lane, before and behind it."""
    places = []
    station = site.ego_station
    if site.ego_waits:
        end = lane_length - junction.FIRST_WAITING + 0.1
        while station + junction.QUEUE_GAP <= end:
            station += junction.QUEUE_GAP
            places.append((station, True))
    else:
        while (station := station + generator.uniform(*CAR_SPACING)) < lane_length - 6:
            places.append((station, False))
    station = site.ego_station
    if site.ego_waits:
        station -= junction.QUEUE_GAP
        places.append((station, True))
    while (station := station - generator.uniform(*CAR_SPACING)) > 4:
        places.append((station, False))
    return places


def _along(
    site: Site, route: experts.Route, generator: np.random.Generator
) -> list[tuple[float, bool]]:
    """Returns places in a lane, with a queue where its light is red at first."""
    places = []
    station = _lane_length(route) - generator.uniform(6.0, 30.0)
    lights = [
        states[0]
        for lane, states in zip(site.controlled, site.light_state, strict=True)
        if lane in route.lanes
    ]
    if lights and lights[0] == LightState.STOP:
        station = _lane_length(route) - junction.FIRST_WAITING
        for _ in range(generator.integers(0, 4)):
            places.append((station, True))
            station -= junction.QUEUE_GAP
        station -= generator.uniform(*CAR_SPACING)
    while station > 4:
        places.append((station, False))
        station -= generator.uniform(*CAR_SPACING)
    return places


def _parked(site: Site, num_parked: int, generator: np.random.Generator) -> list[Mover]:
    """Returns cars on a shoulder that is wide enough for them."""
    profile = site.profile
    if profile.shoulder < PARKED_SHOULDER:
        return []
    num_steps = site.light_state.shape[1]
    side = profile.lane_width / 2 + profile.shoulder - PARKED_SIDE
    movers = []
    for lane in (profile.num_lanes - 1, 2 * profile.num_lanes - 1):
        route = experts.route([site.lanes[lane]])
        station = generator.uniform(10.0, 60.0)
        for size in _sizes(np.zeros(num_parked // 2, bool), generator):
            station += generator.uniform(*PARKED_SPACING)
            movers.append(
                Mover(
                    object_type=ObjectType.VEHICLE,
                    size=size,
                    route=route,
                    station=np.full(num_steps, station),
                    speed=np.zeros(num_steps),
                    left=np.full(num_steps, -side),
                    slope=np.zeros(num_steps),
                )
            )
    return movers


def _walking(
    site: Site, num_walkers: int, generator: np.random.Generator
) -> list[Mover]:
    """Returns pedestrians beside the road, and on crossings while all cars wait."""
    time = experts.DT * np.arange(site.light_state.shape[1])
    across = 2 * site.profile.half_width + FOOTWAY + CLEARANCE
    movers = []
    for _ in range(num_walkers):
        speed = generator.uniform(*WALKING_SPEED)
        if site.crossings and generator.uniform() < SHARE_AT_CROSSINGS:
            line = site.crossings[generator.integers(len(site.crossings))]
            crossed = speed * site.walk_time
            station = across - crossed * generator.uniform() if crossed else 0.0
            speed = speed if crossed else 0.0
        else:
            line = site.footways[generator.integers(len(site.footways))]
            line = line[:: int(generator.choice([-1, 1]))]
            station = generator.uniform(0.0, 100.0)
        width = generator.uniform(0.5, 0.8)
        movers.append(
            Mover(
                object_type=ObjectType.PEDESTRIAN,
                size=np.array([width, width, generator.uniform(1.5, 1.9)]),
                route=experts.route([line]),
                station=station + speed * time,
                speed=np.full_like(time, speed),
                left=np.full_like(time, generator.uniform(-0.5, 0.5)),
                slope=np.zeros_like(time),
            )
        )
    return movers


def _sizes(
    is_cyclist: Bool[np.ndarray, " objects"], generator: np.random.Generator
) -> Float[np.ndarray, "objects 3"]:
    """Returns length, width and height: bicycles, cars, and now and then a van."""
    num = len(is_cyclist)
    is_van = (generator.uniform(size=num) < 0.1)[:, None]
    car = generator.uniform([4.2, 1.75, 1.4], [5.0, 2.0, 1.8], (num, 3))
    van = generator.uniform([5.2, 1.95, 2.2], [6.0, 2.1, 2.8], (num, 3))
    bicycle = generator.uniform([1.6, 0.5, 1.6], [1.9, 0.7, 1.9], (num, 3))
    return np.where(is_cyclist[:, None], bicycle, np.where(is_van, van, car))


def _is_outer(site: Site, lane: int) -> bool:
    return lane % site.profile.num_lanes == site.profile.num_lanes - 1


def _lane_length(route: experts.Route) -> float:
    return float(route.begin[1] if len(route.begin) > 1 else route.station[-1])


def _at(route: experts.Route, station: float) -> Float[np.ndarray, " 2"]:
    return np.array([np.interp(station, route.station, xy) for xy in route.xy.T])
