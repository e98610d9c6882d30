"""Generates scenarios that nobody owns: the data that the package comes with.

A seed gives roads, lights and rule-based traffic; what is seen is enough to predict
what the experts do. The result is a scenario as a reader returns it, paths included.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..scenario import Lights, MapType, Polylines, Scenario, Tracks, check
from . import (
    parts,
    routes,
    synthetic_curve,
    synthetic_junction,
    synthetic_traffic as traffic,
)
from .synthetic_roads import Line, Site, rotate
from .synthetic_tracks import log

NUM_STEPS = 91
FAR = 5000.0  # metres from the map's origin, at most, in each direction
STEEPEST = 0.03  # rise per metre
SITES = {"curve": synthetic_curve.site, "junction": synthetic_junction.site}


@dataclasses.dataclass(frozen=True, kw_only=True)
class SyntheticConfig:
    """What to generate.

    Raises:
        ValueError: if a kind is not known or a range is empty.
    """

    kinds: tuple[str, ...] = ("curve", "junction")  # equally often
    min_others: int = 6  # road users besides the ego; some are left out again
    max_others: int = 20

    def __post_init__(self) -> None:
        unknown = set(self.kinds) - set(SITES)
        if unknown or not self.kinds:
            raise ValueError(
                f"kinds must be some of {', '.join(SITES)}, got {self.kinds}"
            )
        if not 3 <= self.min_others <= self.max_others:
            raise ValueError(
                "min_others must be from 3 to max_others, got "
                f"{self.min_others} and {self.max_others}"
            )


DEFAULT_CONFIG = SyntheticConfig()


@dataclasses.dataclass(frozen=True)
class _Place:
    """Where on the map a site lies: turned, moved, and on a slope."""

    angle: float
    origin: Float[np.ndarray, " 3"]
    slope: Float[np.ndarray, " 2"]

    def __call__(self, xy: Float[np.ndarray, "*any 2"]) -> Float[np.ndarray, "*any 3"]:
        z = xy @ self.slope
        return np.concatenate([rotate(xy, self.angle), z[..., None]], -1) + self.origin


def generate(seed: int, config: SyntheticConfig = DEFAULT_CONFIG) -> Scenario:
    """Returns the scenario of a seed, the same on every machine."""
    generator = np.random.Generator(np.random.PCG64(seed))
    kind = str(generator.choice(config.kinds))
    site = SITES[kind](generator, NUM_STEPS)
    num_others = int(generator.integers(config.min_others, config.max_others + 1))
    movers = traffic.fill(site, num_others, generator)
    is_flat = generator.uniform() < 0.4
    place = _Place(
        angle=generator.uniform(-np.pi, np.pi),
        origin=generator.uniform([-FAR, -FAR, 0.0], [FAR, FAR, 200.0]),
        slope=generator.uniform(-STEEPEST, STEEPEST, 2) * (0.0 if is_flat else 1.0),
    )
    scenario = Scenario(
        scenario_id=f"synthetic-{seed:06d}-{kind}",
        dataset="synthetic",
        tracks=_tracks(movers, place),
        ego_index=0,
        ego_source="marked",
        roads=_roads(site, place),
        lights=_lights(site, place),
        lane_links=parts.lane_links(
            successor=[(a + 1, b + 1) for a, b in site.successor],
            neighbor=[(a + 1, b + 1) for a, b in site.neighbor],
            stop=[],
            limits={},
        ),
    )
    return routes.with_paths(check(scenario))


def _tracks(movers: list[traffic.Mover], place: _Place) -> Tracks:
    planar = log(movers)
    num_objects = len(planar.object_type)
    height = planar.size[:, None, 2:] / 2
    valid = planar.valid
    yaw = np.where(valid, planar.yaw + place.angle, 0.0)
    return Tracks(
        object_id=1 + np.arange(num_objects),
        object_type=planar.object_type,
        xyz=valid[..., None] * (place(planar.xy) + height * [0.0, 0.0, 1.0]),
        yaw=(yaw + np.pi) % (2 * np.pi) - np.pi,
        velocity=valid[..., None] * rotate(planar.velocity, place.angle),
        valid=valid,
        size=planar.size,
        is_of_interest=np.zeros(num_objects, bool),
    )


def _roads(site: Site, place: _Place) -> Polylines:
    """Lays out the map; the lane with index i has the id i + 1."""
    lanes = [(MapType.LANE_SURFACE_STREET, lane) for lane in site.lanes]
    features: list[tuple[MapType, Line]] = [*lanes, *site.shapes]
    return Polylines(
        xyz=place(np.concatenate([line for _, line in features])),
        offset=np.cumsum([0, *(len(line) for _, line in features)]),
        map_type=np.array([int(kind) for kind, _ in features]),
        feature_id=1 + np.arange(len(features)),
    )


def _lights(site: Site, place: _Place) -> Lights:
    stops = np.array([site.lanes[lane][0] for lane in site.controlled]).reshape(-1, 2)
    return Lights(
        lane_id=1 + np.array(site.controlled, int),
        xyz=place(stops),
        state=site.light_state,
        valid=np.ones(site.light_state.shape, bool),
    )
