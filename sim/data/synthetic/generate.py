"""Generates scenarios: a seed gives a town, its lights and rule-based traffic.

What is seen is enough to predict what the experts do. The result is a scenario as a
reader returns it, paths included.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ...scenario import Lights, MapType, Polylines, Scenario, Tracks, check
from .. import parts, routes
from . import (
    courses,
    ego,
    log,
    network as networks,
    noise,
    parking,
    population,
    sight,
    town as towns,
    traffic,
    walkers,
)
from .lines import Line, rotate, snap
from .log import PlanarTracks
from .mover import Mover
from .network import Network

NUM_STEPS = 91
WARM_UP = 32  # steps that are driven before the log begins
FAR = 5000.0  # metres from the map's origin, at most, in each direction
LIGHTS_SHARE = 0.7  # of the logs, that tell what lights show
LIGHT_RANGE = 45.0  # metres from the ego at some step
STEEPEST = 0.03  # rise per metre
ATTEMPTS = 30  # at towns, until one has an ego
LIKELY = {
    "junction": 0.6,
    "road": 0.18,
    "carpark": 0.1,
    "roundabout": 0.07,
    "ramp": 0.05,
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class SyntheticConfig:
    """What to generate.

    Raises:
        ValueError: if a kind is not known or nobody else may be there.
    """

    kinds: tuple[str, ...] = tuple(LIKELY)  # of the piece that a town grows around
    max_others: int = 127  # road users besides the ego, the nearest first

    def __post_init__(self) -> None:
        unknown = set(self.kinds) - set(LIKELY)
        if unknown or not self.kinds:
            raise ValueError(
                f"kinds must be some of {', '.join(LIKELY)}, got {self.kinds}"
            )
        if self.max_others < 1:
            raise ValueError(f"max_others must be at least 1, got {self.max_others}")


DEFAULT_CONFIG = SyntheticConfig()


@dataclasses.dataclass(frozen=True)
class _Place:
    """Where on the map a town lies: turned, moved, and on a slope."""

    angle: float
    origin: Float[np.ndarray, " 3"]
    slope: Float[np.ndarray, " 2"]

    def __call__(self, xy: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 3"]:
        z = xy[..., 0] * self.slope[0] + xy[..., 1] * self.slope[1]
        flat = rotate(xy, self.angle)
        return snap(np.concatenate([flat, z[..., None]], -1) + self.origin)


def generate(seed: int, config: SyntheticConfig = DEFAULT_CONFIG) -> Scenario:
    """Returns the scenario of a seed, the same on every machine."""
    generator = np.random.Generator(np.random.PCG64(seed))
    weights = np.array([LIKELY[kind] for kind in config.kinds])
    kind = config.kinds[_drawn(generator, weights)]
    for _ in range(ATTEMPTS):
        town = towns.draw(generator, kind)
        net = networks.network(generator, town, WARM_UP + NUM_STEPS)
        planar = _traffic(generator, net, config.max_others)
        if planar is not None:
            break
    else:
        raise RuntimeError(f"seed {seed}: no town of kind '{kind}' has an ego")
    is_flat = generator.uniform() < 0.4
    place = _Place(
        angle=generator.uniform(-np.pi, np.pi),
        origin=generator.uniform([-FAR, -FAR, 0.0], [FAR, FAR, 200.0]),
        slope=generator.uniform(-STEEPEST, STEEPEST, 2) * (0.0 if is_flat else 1.0),
    )
    roads, stop = _roads(net, place)
    scenario = Scenario(
        scenario_id=f"synthetic-{seed:06d}-{kind}",
        dataset="synthetic",
        tracks=_tracks(planar, place),
        ego_index=0,
        ego_source="marked",
        roads=roads,
        lights=_lights(net, place, _seen_lights(generator, net, planar)),
        lane_links=parts.lane_links(
            successor=[(a + 1, b + 1) for a, b in town.successor],
            neighbor=[(a + 1, b + 1) for a, b in town.neighbor],
            stop=stop,
            limits={i + 1: lane.limit for i, lane in enumerate(town.lanes)},
        ),
    )
    return routes.with_paths(check(scenario))


def _drawn(
    generator: np.random.Generator, weights: Float[np.ndarray, " choices"]
) -> int:
    total = np.cumsum(weights)
    drawn = generator.uniform() * total[-1]
    return min(int(np.searchsorted(total, drawn, side="right")), len(weights) - 1)


def _traffic(
    generator: np.random.Generator, net: Network, max_others: int
) -> PlanarTracks | None:
    """Returns the log of a town, the ego first; None if nobody can be the ego."""
    rules = courses.rules(net)
    num_steps = WARM_UP + NUM_STEPS
    beside, across = walkers.walkers(generator, rules, num_steps)
    is_walked = walkers.is_walked(rules, across, num_steps)
    drivers, start = population.people(generator, rules)
    if not start.ways:
        return None
    drive = traffic.drive(generator, rules, drivers, start, is_walked)
    driven = log.driven(generator, net, drivers, drive, WARM_UP)
    parked = parking.parked(generator, net.town, NUM_STEPS)
    on_foot = [_late(walker) for walker in (*across, *beside)]
    tracks = log.tracks([*driven, *on_foot, *parked])
    own = ego.choose(generator, tracks, len(driven))
    if own is None:
        return None
    rows = np.arange(len(tracks.object_type))
    tracks = tracks.of(np.concatenate([[own], rows[rows != own]]))
    tracks = dataclasses.replace(tracks, valid=sight.seen(generator, tracks))
    tracks = noise.perceived(generator, tracks)
    tracks = tracks.of(np.flatnonzero(tracks.valid.any(axis=1)))
    tracks = tracks.of(np.flatnonzero(~log.overlaps_earlier(tracks)))
    return _nearest(tracks, max_others)


def _late(walker: Mover) -> Mover:
    """Returns a pedestrian from the first step of the log on."""
    names = ("xy", "yaw", "velocity", "is_there")
    cut = {name: getattr(walker, name)[WARM_UP:] for name in names}
    return dataclasses.replace(walker, **cut)


def _nearest(tracks: PlanarTracks, max_others: int) -> PlanarTracks:
    gap = np.where(tracks.valid[..., None], tracks.xy - tracks.xy[:1], np.inf)
    distance = (gap[..., 0] ** 2 + gap[..., 1] ** 2).min(axis=1)
    distance[0] = -1.0
    kept = np.argsort(distance, kind="stable")[: max_others + 1]
    return tracks.of(np.sort(kept))


def _tracks(planar: PlanarTracks, place: _Place) -> Tracks:
    num_objects = len(planar.object_type)
    height = planar.size[:, None, 2:] / 2
    valid = planar.valid
    yaw = np.where(valid, planar.yaw + place.angle, 0.0)
    lifted = place(planar.xy) + height * [0.0, 0.0, 1.0]
    return Tracks(
        object_id=1 + np.arange(num_objects),
        object_type=planar.object_type,
        xyz=valid[..., None] * snap(lifted),
        yaw=snap(np.mod(yaw + np.pi, 2 * np.pi) - np.pi),
        velocity=valid[..., None] * snap(rotate(planar.velocity, place.angle)),
        valid=valid,
        size=planar.size,
        is_of_interest=np.zeros(num_objects, bool),
    )


def _roads(net: Network, place: _Place) -> tuple[Polylines, list[tuple[int, int]]]:
    """Lays out the map, and ties stop signs to lanes.

    The lane with index i has the id i + 1.
    """
    town = net.town
    features: list[tuple[MapType, Line]] = [
        (lane.map_type, lane.line) for lane in town.lanes
    ]
    stop = []
    for base, piece in zip(town.first_lane.tolist(), town.pieces, strict=True):
        features += piece.shapes
        for sign, lanes in piece.signs:
            features.append((MapType.STOP_SIGN, snap(np.array([[sign.x, sign.y]]))))
            stop += [(len(features), base + lane + 1) for lane in lanes]
    roads = Polylines(
        xyz=place(np.concatenate([line for _, line in features])),
        offset=np.cumsum([0, *(len(line) for _, line in features)]),
        map_type=np.array([int(kind) for kind, _ in features]),
        feature_id=1 + np.arange(len(features)),
    )
    return roads, stop


def _seen_lights(
    generator: np.random.Generator, net: Network, planar: PlanarTracks
) -> Int[np.ndarray, " seen"]:
    """Returns the lights that the ego comes near to; many logs show none at all."""
    sees = generator.uniform() < LIGHTS_SHARE
    stops = np.array([net.town.lanes[lane].line[0] for lane in net.lit.tolist()])
    gap = stops.reshape(-1, 1, 2) - planar.xy[0]
    near = (gap[..., 0] ** 2 + gap[..., 1] ** 2 < LIGHT_RANGE**2).any(axis=1)
    return np.flatnonzero(near & sees)


def _lights(net: Network, place: _Place, seen: Int[np.ndarray, " seen"]) -> Lights:
    lit = net.lit[seen]
    stops = np.array([net.town.lanes[lane].line[0] for lane in lit.tolist()])
    state = net.light_state[seen, WARM_UP:]
    return Lights(
        lane_id=1 + lit,
        xyz=place(stops.reshape(-1, 2)),
        state=state,
        valid=np.ones(state.shape, bool),
    )
