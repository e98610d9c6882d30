"""Observes the world as vectors in the pose of the viewer (W 3.2).

Groups of tokens: the viewer and the nearest objects with their history, the nearest
pieces of the map, the traffic lights, places ahead on the route, and the goal. Any
object can be the viewer; what it is called here, the ego, is the one that looks.
"""

import dataclasses
import math
from dataclasses import field
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .. import geometry, ranges
from ..map_search import FAR
from ..metrics import route
from ..metrics.build import EGO
from ..motion import Motion
from ..scenario import EDGES, LANES, NUM_MAP_TYPES, LightState, MapType, ObjectType
from ..scene import Scene
from . import describe
from .base import Observation, Observer, Slot, TokenGroup, View
from .ego_frame import LENGTH_UNIT, SIZE_UNIT, EgoFrame, stack
from .nearest import nearest
from .noise import NoiseConfig, blurred
from .one_hot import one_hot_rows

Road = Literal["segments", "points"]
OBJECT_KINDS = (ObjectType.VEHICLE, ObjectType.PEDESTRIAN, ObjectType.CYCLIST)
ROAD_KINDS = {
    "lane": LANES,
    "line": tuple(range(MapType.LINE_UNKNOWN, MapType.EDGE_UNKNOWN)),
    "edge": EDGES,
    "stop_sign": (MapType.STOP_SIGN,),
    "crosswalk": (MapType.CROSSWALK,),
    "bump_or_driveway": (MapType.SPEED_BUMP, MapType.DRIVEWAY),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class VectorConfig:
    """How much of the world the ego sees.

    A piece of the map is a segment of a simplified line, or a point of the lines as
    they are stored; the last point of a line, which leads nowhere, is no piece. Stores
    keep all logged points where `prepare` ran with `--simplify 0`.
    """

    name: Literal["vector"] = "vector"
    history: int = 10  # steps before the present one
    num_objects: int = 16
    road: Road = "segments"  # what a piece of a map feature is
    num_road: int = 128  # pieces of map features
    num_lights: int = 8  # 0 leaves the lights out
    num_route: int = 16  # places ahead on the route; 0 leaves the route out
    route_spacing: float = 4.0  # metres between them
    goal: bool = False  # show where and how the log ends
    radius: float = 80.0  # metres beyond which nothing is seen but the goal
    noise: NoiseConfig = field(default_factory=NoiseConfig)  # of what is seen of others

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a count is negative or a length is not positive.
        """
        ranges.require_at_least(
            self, history=0, num_objects=1, num_road=1, num_lights=0, num_route=0
        )
        for name in ("route_spacing", "radius"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f"{name} must be a positive length, got {getattr(self, name)}."
                )


def vector(config: VectorConfig) -> Observer:
    """Builds the observer.

    The route is that of the scenario's ego: others see it masked. An object that is not
    there sees nothing: all is masked.
    """

    def observe(view: View, number: Int[Array, ""]) -> Observation:
        scene, key = view.scene, jax.random.fold_in(view.key, number)
        motion = blurred(config.noise, view.motion, number, key)
        now = jax.tree.map(lambda leaf: leaf[-1], motion)
        ego = EgoFrame(xy=now.xy[number], yaw=now.yaw[number])
        seen = _road_users(view, motion, ego)
        groups = {
            "ego": _tokens(seen[:, number, None], motion.valid[:, number, None]),
            "objects": _objects(config, now, number, seen, motion.valid),
            "road": _road(config, scene, ego, now.valid[number]),
        }
        if config.num_lights:
            groups["lights"] = _lights(config, scene, ego, view.step)
        if config.num_route:
            groups["route"] = _route(config, scene, ego, number == EGO)
        if config.goal:
            groups["goal"] = _goal(view.goal.motion, ego, number)
        is_here = now.valid[number]
        return jax.tree.map(
            lambda leaf: jnp.where(is_here, leaf, jnp.zeros_like(leaf)), groups
        )

    return Observer(config.history, observe, lambda: slots(config))


def slots(config: VectorConfig) -> tuple[Slot, ...]:
    """Returns what the features of each group are."""
    # Who is near now may have been far away.
    radius = math.inf if config.history else config.radius
    found: tuple[Slot, ...] = ()
    for group in ("ego", "objects"):
        found += describe.place(group, radius=radius) + describe.heading(group)
        found += describe.velocity(group) + describe.size(group)
        found += describe.kinds(group, (kind.name.lower() for kind in OBJECT_KINDS))
    found += describe.place("road", radius=config.radius)
    if config.road == "points":
        found += describe.heading("road")
    else:
        found += describe.place("road", "start_") + describe.place("road", "end_")
    found += describe.kinds("road", ROAD_KINDS)
    if config.num_lights:
        found += describe.place("lights", radius=config.radius)
        found += describe.kinds("lights", (state.name.lower() for state in LightState))
    if config.num_route:
        found += describe.place("route", radius=config.radius)
        found += describe.heading("route")
    if config.goal:
        found += describe.place("goal") + describe.heading("goal")
        found += describe.velocity("goal")
    return found


def _road_users(view: View, motion: Motion, ego: EgoFrame):
    """Shows all objects at all steps."""
    kinds = jnp.asarray(_OBJECT_KIND)[view.scene.object_type]
    shape = motion.yaw.shape
    return stack(
        ego.place(motion.xy),
        ego.heading(motion.yaw),
        ego.velocity(motion.velocity),
        jnp.broadcast_to(view.object_size[:, :2] / SIZE_UNIT, (*shape, 2)),
        jnp.broadcast_to(kinds, (*shape, kinds.shape[-1])),
    )


def _tokens(values, mask) -> TokenGroup:
    """Makes tokens of values and a mask whose leading axis is steps."""
    values = jnp.where(mask[..., None], values, 0.0)
    return TokenGroup(values=jnp.swapaxes(values, 0, 1), mask=mask.T)


def _objects(config, now: Motion, ego, seen, valid) -> TokenGroup:
    distance = geometry.norm(now.xy - now.xy[ego, None])
    there = now.valid & (distance <= config.radius)
    number, present = nearest(distance, there.at[ego].set(False), config.num_objects)
    return _tokens(seen[:, number], valid[:, number] & present[None])


def _road(config, scene: Scene, ego: EgoFrame, is_here) -> TokenGroup:
    """Shows the nearest pieces of the map.

    A segment: its nearest point, its ends and its kind. A point: its place, the
    direction to the next one, zero for a sign, and its kind.
    """
    by_segment = config.road == "segments"
    place = jnp.where(is_here, ego.xy, FAR)
    pieces = scene.nearest_pieces(place, config.num_road, config.radius, by_segment)
    start, along = pieces.start[:, :2], (pieces.end - pieces.start)[:, :2]
    if by_segment:
        share = geometry.nearest_on_segment(ego.xy[None], start, start + along)
        closest = ego.place(start + share[:, None] * along)
        places = closest, ego.place(start), ego.place(start + along)
    else:
        length = geometry.norm(along)
        unit = along / jnp.where(length > 0, length, 1.0)[:, None]
        places = ego.place(start), geometry.to_frame(unit, ego.yaw)
    kinds = jnp.asarray(_ROAD_KIND)[pieces.map_type]
    return _tokens(stack(*places, kinds)[None], pieces.valid[None])


def _lights(config, scene: Scene, ego: EgoFrame, step) -> TokenGroup:
    lights = scene.lights_at(step)
    distance = geometry.norm(lights.xyz[:, :2] - ego.xy[None])
    there = lights.valid & (distance <= config.radius)
    number, present = nearest(distance, there, config.num_lights)
    state = jax.nn.one_hot(lights.state[number], len(LightState))
    place = ego.place(lights.xyz[number, :2])
    return _tokens(stack(place, state)[None], present[None])


def _route(config, scene: Scene, ego: EgoFrame, is_own) -> TokenGroup:
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
    return _tokens(stack(place, heading)[None], (reached & near & is_own)[None])


def _goal(goal: Motion, ego: EgoFrame, number) -> TokenGroup:
    """Shows the motion with which the log of the ego ends."""
    seen = stack(ego.place(goal.xy), ego.heading(goal.yaw), ego.velocity(goal.velocity))
    return _tokens(seen[None, number, None], goal.valid[None, number, None])


_OBJECT_KIND = one_hot_rows([(kind,) for kind in OBJECT_KINDS], len(ObjectType))
_ROAD_KIND = one_hot_rows(ROAD_KINDS.values(), NUM_MAP_TYPES)
