"""Draws a four-way junction with traffic lights.

Arm k leaves the middle at k quarter turns; the ego comes in on arm 0. Arms with one
lane in each direction get their green one after the other; with two, the left lane
turns left in a phase of its own, together with the arm opposite.
"""

import dataclasses

import numpy as np

from ..scenario import LightState, MapType
from . import synthetic_roads as roads

ARM = 130.0  # metres from the corner of the junction to the end of an arm
APPROACH = 6  # stretches between a stop line and the corner, where pedestrians cross
CORNER = (7.2, 9.5)  # metres from an edge to the corner that its rounding cuts off
STRAIGHT = 12.0  # metres of an arm before it bends
BEND_LENGTH = 70.0  # metres
MIN_BEND, MAX_BEND = np.radians(15.0), np.radians(42.0)  # arms never meet again
YELLOW, ALL_RED = 3.0, 2.0  # seconds
QUEUE_GAP = 7.5  # metres from one waiting car to the next
FIRST_WAITING = 4.6  # metres from a stop line to the first one's centre
RIGHT, AHEAD, LEFT = (
    1,
    2,
    3,
)  # movements, as the number of arms to the one they leave by
WALK = -1  # the phase in which all cars wait and pedestrians cross


@dataclasses.dataclass(frozen=True)
class _Plan:
    """Which phase has green when: `before` until `switch`, `after` when it is clear."""

    before: int
    after: int
    switch: float  # seconds


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Network:
    """The lanes of a junction: in and out by arm, then those across it."""

    lanes: tuple[roads.Line, ...]
    successor: tuple[tuple[int, int], ...]
    neighbor: tuple[tuple[int, int], ...]
    routes: tuple[tuple[int, ...], ...]  # across by arm and movement, then ways out
    controlled: tuple[int, ...]  # lanes across
    phases: tuple[int, ...]  # in which they have green


def site(generator: np.random.Generator, num_steps: int) -> roads.Site:
    """Returns a junction; the lights make the ego go, stop, or wait and go."""
    profile = roads.Profile(
        num_lanes=int(generator.integers(1, 3)),
        lane_width=generator.uniform(3.3, 3.7),
        shoulder=float(generator.choice([0.5, 1.0])),
    )
    corner = profile.half_width + generator.uniform(*CORNER)
    arms = [_arm(generator, profile, corner, k) for k in range(4)]
    network = _network(arms, profile, corner)

    movement = int(generator.choice([RIGHT, AHEAD, LEFT], p=[0.35, 0.3, 0.35]))
    ego_route = movement - 1
    phase = network.phases[ego_route]
    plan, distance, ego_waits = _situation(generator, phase)
    lane_in = network.lanes[network.routes[ego_route][0]]
    return roads.Site(
        kind="junction",
        profile=profile,
        lanes=network.lanes,
        shapes=_shapes(arms, profile, corner),
        successor=network.successor,
        neighbor=network.neighbor,
        routes=network.routes,
        ego_route=ego_route,
        ego_station=_length(lane_in) - distance,
        ego_waits=ego_waits,
        controlled=network.controlled,
        light_state=_light_state(plan, np.array(network.phases), num_steps),
        footways=tuple(way[APPROACH:] for arm in arms for way in arm.footways),
        crossings=tuple(_crossing(profile, corner, k) for k in range(4)),
        walk_time=plan.switch + ALL_RED if plan.before == WALK else 0.0,
    )


def _network(arms: list[roads.Road], profile: roads.Profile, corner: float) -> _Network:
    num = profile.num_lanes
    lanes, successor, neighbor = [], [], []
    for arm in arms:  # arm k: lanes in from 2 k num, lanes out from (2 k + 1) num
        for run in (
            [lane[:-APPROACH] for lane in arm.backward],
            [lane[APPROACH:] for lane in arm.forward],
        ):
            neighbor += roads.beside(range(len(lanes), len(lanes) + num))
            lanes += run
    across, phases = [], []
    for k in range(4):
        for movement in (RIGHT, AHEAD, LEFT):
            side = 0 if movement == LEFT else num - 1
            lane_in = 2 * k * num + side
            lane_out = (2 * ((k + movement) % 4) + 1) * num + side
            across.append((lane_in, len(lanes), lane_out))
            phases.append(_phase(k, movement, num))
            successor += [(lane_in, len(lanes)), (len(lanes), lane_out)]
            lanes.append(_connector(profile, corner, k, movement))
    ways_out = [((2 * k + 1) * num + i,) for k in range(4) for i in range(num)]
    return _Network(
        lanes=tuple(lanes),
        successor=tuple(successor),
        neighbor=tuple(neighbor),
        routes=(*across, *ways_out),
        controlled=tuple(lane for _, lane, _ in across),
        phases=tuple(phases),
    )


def _arm(
    generator: np.random.Generator, profile: roads.Profile, corner: float, k: int
) -> roads.Road:
    angle = generator.uniform(MIN_BEND, MAX_BEND) * generator.choice([-1.0, 1.0])
    begin, bend = round(STRAIGHT / roads.STEP), round(BEND_LENGTH / roads.STEP)
    curvature = np.zeros(round(ARM / roads.STEP))
    curvature[begin : begin + bend] = roads.arc(angle, bend) / roads.STEP
    xy, yaw = roads.bend(curvature, roads.STEP)
    xy[:, 0] += corner
    quarter = k * np.pi / 2
    return roads.road(roads.rotate(xy, quarter), yaw + quarter, profile)


def _connector(
    profile: roads.Profile, corner: float, k: int, movement: int
) -> roads.Line:
    """Returns the lane across the junction, stop line to stop line."""
    lead = APPROACH * roads.STEP
    if movement == AHEAD:
        length = 2 * (corner + lead)
        x = np.linspace(0.0, length, round(length / roads.STEP) + 1)
        xy, side = np.stack([x, np.zeros_like(x)], axis=-1), profile.num_lanes - 1
    elif movement == RIGHT:
        side = profile.num_lanes - 1
        xy = roads.turn(-np.pi / 2, corner - profile.lane_offset(side), lead)
    else:
        side = 0
        xy = roads.turn(np.pi / 2, corner + profile.lane_offset(side), lead)
    begin = np.array([corner + lead, profile.lane_offset(side)])
    return roads.rotate(begin - xy, k * np.pi / 2)  # drivers come in along -x


def _shapes(
    arms: list[roads.Road], profile: roads.Profile, corner: float
) -> tuple[tuple[MapType, roads.Line], ...]:
    half = profile.half_width
    shapes = []
    for k, arm in enumerate(arms):
        shapes += [(kind, line[APPROACH:]) for kind, line in arm.markings]
        rounding = [corner, half] - roads.turn(-np.pi / 2, corner - half, 0.0)
        rounding = roads.rotate(rounding, k * np.pi / 2)
        leaving = arms[(k + 1) % 4].right_edge
        edge = np.concatenate([arm.left_edge, rounding[1:-1], leaving])
        shapes.append((MapType.EDGE_BOUNDARY, edge))
        near, far = corner + roads.STEP, corner + 4.0
        box = [[near, -half], [far, -half], [far, half], [near, half], [near, -half]]
        polygon = roads.rotate(np.array(box), k * np.pi / 2)
        shapes.append((MapType.CROSSWALK, polygon))
    return tuple(shapes)


def _crossing(profile: roads.Profile, corner: float, k: int) -> roads.Line:
    """Returns a footway across arm k, with room to walk on behind the road."""
    reach = profile.half_width + roads.FOOTWAY
    y = np.arange(-reach, reach + 15.0, 1.0)
    x = np.full_like(y, corner + (roads.STEP + 4.0) / 2)
    side = 1.0 if k % 2 else -1.0
    return roads.rotate(np.stack([x, side * y], axis=-1), k * np.pi / 2)


def _phase(arm: int, movement: int, num_lanes: int) -> int:
    """Returns the phase that gives a movement its green; flows in one never cross."""
    if num_lanes == 1:
        return arm
    return 2 * (arm % 2) + (movement == LEFT)


def _situation(
    generator: np.random.Generator, ego_phase: int
) -> tuple[_Plan, float, bool]:
    """Returns the lights' plan, the ego's distance to its line, and if it waits."""
    other = (ego_phase + int(generator.integers(1, 4))) % 4
    case = generator.choice(["go", "stop", "start"], p=[0.5, 0.2, 0.3])
    if case == "go":
        never = np.inf
        return _Plan(ego_phase, other, never), generator.uniform(15.0, 55.0), False
    if case == "stop":
        switch = generator.uniform(0.0, 2.0)
        return _Plan(ego_phase, other, switch), generator.uniform(35.0, 65.0), False
    if generator.uniform() < 0.5:
        before, switch = WALK, generator.uniform(3.0, 6.5) - ALL_RED
    else:
        before, switch = other, generator.uniform(1.5, 5.0) - ALL_RED - YELLOW
    if generator.uniform() < 0.5:
        place = FIRST_WAITING + QUEUE_GAP * int(generator.integers(0, 2))
        return _Plan(before, ego_phase, switch), place, True
    return _Plan(before, ego_phase, switch), generator.uniform(30.0, 60.0), False


def _light_state(plan: _Plan, phases: np.ndarray, num_steps: int) -> np.ndarray:
    """Returns what each light shows at each step."""
    time = 0.1 * np.arange(num_steps)[None]
    yellow = 0.0 if plan.before == WALK else YELLOW
    is_before, is_after = phases[:, None] == plan.before, phases[:, None] == plan.after
    go = (is_before & (time < plan.switch)) | (
        is_after & (time >= plan.switch + yellow + ALL_RED)
    )
    caution = is_before & (time >= plan.switch) & (time < plan.switch + yellow)
    return np.select(
        [go, caution], [LightState.GO, LightState.CAUTION], LightState.STOP
    )


def _length(line: roads.Line) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
