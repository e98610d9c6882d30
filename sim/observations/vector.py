"""Observes the world as vectors in the pose of the ego (W 3.2).

Five groups of tokens: the ego and the nearest objects with their history, the nearest
pieces of the map, the traffic lights, and places ahead on the route.
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .. import geometry
from ..metrics import route
from ..motion import Motion
from ..scenario import EDGES, LANES, NUM_MAP_TYPES, LightState, MapType, ObjectType
from ..scene import Scene
from .base import Observation, Observer, TokenGroup, View
from .ego_frame import LENGTH_UNIT, SIZE_UNIT, EgoFrame, stack
from .nearest import nearest

OBJECT_KINDS = (ObjectType.VEHICLE, ObjectType.PEDESTRIAN, ObjectType.CYCLIST)
ROAD_KINDS = (
    LANES,
    tuple(range(MapType.LINE_UNKNOWN, MapType.EDGE_UNKNOWN)),
    EDGES,
    (MapType.STOP_SIGN,),
    (MapType.CROSSWALK,),
    (MapType.SPEED_BUMP, MapType.DRIVEWAY),
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class VectorConfig:
    """How much of the world the ego sees."""

    history: int = 10  # steps before the present one
    num_objects: int = 16
    num_road: int = 128  # pieces of map features
    num_lights: int = 8
    num_route: int = 16  # places ahead on the route; 0 leaves the route out
    route_spacing: float = 4.0  # metres between them
    radius: float = 80.0  # metres beyond which nothing is seen

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a count is negative or a length is not positive.
        """
        for name, least in (
            ("history", 0),
            ("num_objects", 1),
            ("num_road", 1),
            ("num_lights", 1),
            ("num_route", 0),
        ):
            if getattr(self, name) < least:
                raise ValueError(
                    f"{name} must be at least {least}, got {getattr(self, name)}."
                )
        for name in ("route_spacing", "radius"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f"{name} must be a positive length, got {getattr(self, name)}."
                )


def vector(config: VectorConfig) -> Observer:
    """Builds the observer."""

    def observe(view: View, number: Int[Array, ""]) -> Observation:
        scene, motion, object_size = view.scene, view.motion, view.object_size
        now = jax.tree.map(lambda leaf: leaf[-1], motion)
        ego = EgoFrame(xy=now.xy[number], yaw=now.yaw[number])
        kinds = jnp.asarray(_OBJECT_KIND)[scene.object_type]
        seen = stack(
            ego.place(motion.xy),
            ego.heading(motion.yaw),
            ego.velocity(motion.velocity),
            jnp.broadcast_to(object_size[:, :2] / SIZE_UNIT, (*motion.yaw.shape, 2)),
            jnp.broadcast_to(kinds, (*motion.yaw.shape, kinds.shape[-1])),
        )
        groups = {
            "ego": _tokens(seen[:, number, None], motion.valid[:, number, None]),
            "objects": _objects(config, now, number, seen, motion.valid),
            "road": _road(config, scene, ego),
            "lights": _lights(config, scene, ego, view.step),
        }
        if config.num_route:
            groups["route"] = _route(config, scene, ego)
        return groups

    return Observer(config.history, observe)


def _tokens(values, mask) -> TokenGroup:
    """Makes tokens of values and a mask whose leading axis is steps."""
    values = jnp.where(mask[..., None], values, 0.0)
    return TokenGroup(values=jnp.swapaxes(values, 0, 1), mask=mask.T)


def _objects(config, now: Motion, ego, seen, valid) -> TokenGroup:
    distance = geometry.norm(now.xy - now.xy[ego, None])
    there = now.valid & (distance <= config.radius)
    number, present = nearest(distance, there.at[ego].set(False), config.num_objects)
    return _tokens(seen[:, number], valid[:, number] & present[None])


def _road(config, scene: Scene, ego: EgoFrame) -> TokenGroup:
    """Shows the nearest pieces of the map: nearest point, both ends and the kind."""
    pieces = scene.map_segments()
    start, end = pieces.start[:, :2], pieces.end[:, :2]
    share = geometry.nearest_on_segment(ego.xy[None], start, end)
    closest = start + share[:, None] * (end - start)
    distance = geometry.norm(closest - ego.xy[None])
    there = pieces.valid & (distance <= config.radius)
    number, present = nearest(distance, there, config.num_road)
    places = (ego.place(xy[number]) for xy in (closest, start, end))
    kinds = jnp.asarray(_ROAD_KIND)[pieces.map_type[number]]
    return _tokens(stack(*places, kinds)[None], present[None])


def _lights(config, scene: Scene, ego: EgoFrame, step) -> TokenGroup:
    lights = scene.lights_at(step)
    distance = geometry.norm(lights.xyz[:, :2] - ego.xy[None])
    there = lights.valid & (distance <= config.radius)
    number, present = nearest(distance, there, config.num_lights)
    state = jax.nn.one_hot(lights.state[number], len(LightState))
    place = ego.place(lights.xyz[number, :2])
    return _tokens(stack(place, state)[None], present[None])


def _route(config, scene: Scene, ego: EgoFrame) -> TokenGroup:
    """Shows places at equal spacing ahead on the nearest on-route path."""
    paths = scene.path_segments()
    here = route.locate(paths, ego.xy)
    arc = here.arc + config.route_spacing * jnp.arange(config.num_route)
    on_path = paths.valid & (paths.path == here.path)
    begun = on_path[None] & (paths.arc[None] <= arc[:, None])
    segment = jnp.argmax(jnp.where(begun, paths.arc[None], -jnp.inf), axis=-1)
    along = (paths.end - paths.start)[segment]
    length = geometry.norm(along)
    share = (arc - paths.arc[segment]) / jnp.where(length > 0, length, 1.0)
    place = ego.place(paths.start[segment] + share[:, None] * along)
    heading = ego.heading(jnp.arctan2(along[:, 1], along[:, 0]))
    reached = jnp.any(begun, axis=-1) & (share <= 1.0 + 1e-3)
    near = geometry.norm(place) * LENGTH_UNIT <= config.radius
    return _tokens(stack(place, heading)[None], (reached & near)[None])


def _groups_of_codes(groups, num_codes: int) -> np.ndarray:
    """Returns the one-hot group of each code; all zero for codes of no group."""
    rows = np.zeros((num_codes, len(groups)), np.float32)
    for number, codes in enumerate(groups):
        rows[list(codes), number] = 1
    return rows


_OBJECT_KIND = _groups_of_codes([(kind,) for kind in OBJECT_KINDS], len(ObjectType))
_ROAD_KIND = _groups_of_codes(ROAD_KINDS, NUM_MAP_TYPES)
