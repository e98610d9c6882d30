"""Draws a road that bends, with one or two lanes in each direction."""

import numpy as np

from ..scenario import MapType
from . import synthetic_roads as roads

LENGTH = 340.0  # metres, at least: nine seconds at 16 m/s, and some road around
MIN_RADIUS, MAX_RADIUS = 30.0, 150.0  # metres, of the middle of the road
MIN_ANGLE, MAX_ANGLE = np.radians(30.0), np.radians(120.0)  # of all bends together
LONGEST_BEND = 150.0  # metres at full curvature
SHOULDERS = (0.5, 1.8, 2.7)  # metres: none, for cyclists, for parked cars


def site(generator: np.random.Generator, num_steps: int) -> roads.Site:
    """Returns a bending road; the ego reaches the bend soon after the history."""
    profile = roads.Profile(
        num_lanes=int(generator.integers(1, 3)),
        lane_width=generator.uniform(3.3, 3.7),
        shoulder=float(generator.choice(SHOULDERS)),
    )
    ego_station = generator.uniform(40.0, 60.0)
    xy, yaw = roads.bend(_curvature(generator, ego_station), roads.STEP)
    road = roads.road(xy, yaw, profile)
    num = profile.num_lanes
    return roads.Site(
        kind="curve",
        profile=profile,
        lanes=road.forward + road.backward,
        shapes=(
            *road.markings,
            (MapType.EDGE_BOUNDARY, road.right_edge),
            (MapType.EDGE_BOUNDARY, road.left_edge),
        ),
        successor=(),
        neighbor=(*roads.beside(range(num)), *roads.beside(range(num, 2 * num))),
        routes=tuple((lane,) for lane in range(2 * num)),
        ego_route=int(generator.integers(num)),
        ego_station=ego_station,
        ego_waits=False,
        controlled=(),
        light_state=np.zeros((0, num_steps), int),
        footways=road.footways,
        crossings=(),
        walk_time=0.0,
    )


def _curvature(generator: np.random.Generator, ego_station: float) -> np.ndarray:
    """Returns the curvature of each stretch: straight, one or two bends, straight."""
    radius = MIN_RADIUS * (MAX_RADIUS / MIN_RADIUS) ** generator.uniform()
    angle = min(generator.uniform(MIN_ANGLE, MAX_ANGLE), LONGEST_BEND / radius)
    share = generator.uniform(0.4, 0.7) if generator.uniform() < 0.4 else 1.0
    side = generator.choice([-1.0, 1.0])
    second_side = generator.choice([-1.0, 1.0]) * side

    straight = ego_station + generator.uniform(12.0, 35.0)
    parts = [np.zeros(round(straight / roads.STEP))]
    for part, turn in ((share, side), (1.0 - share, second_side)):
        # The ramps turn half as much as the rest: lengthen the bend by one of them.
        length = part * angle * radius / (1.0 - roads.RAMP)
        num_cells = round(length / roads.STEP)
        if num_cells:
            parts.append(roads.arc(turn * part * angle, num_cells) / roads.STEP)
            parts.append(np.zeros(int(generator.integers(0, 25))))
    curvature = np.concatenate(parts)
    missing = max(round(LENGTH / roads.STEP) - len(curvature), 0)
    return np.append(curvature, np.zeros(missing))
