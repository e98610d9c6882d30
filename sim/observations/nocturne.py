"""Observes the world as Nocturne does: a cone in which boxes hide what is behind them.

Five groups of tokens, each with the nearest first: the viewer, objects, points of the
road, traffic lights and stop signs (N 3.4, A.3 and A.4). `flat` lays them out as the
published vector. Nothing is normalized.
"""

import dataclasses
import math
from collections.abc import Iterable
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .. import geometry, ranges
from ..box_search import Boxes
from ..dynamics.speed import signed_speed
from ..motion import Motion
from ..scenario import EDGES, LANES, NUM_MAP_TYPES, LightState, MapType, ObjectType
from ..scene import Scene
from ..scene_records import Lights, Points
from .base import Observation, Observer, Slot, TokenGroup, View
from .ego_frame import stack
from .nearest import nearest
from .one_hot import one_hot_rows
from .visibility import Cone, visible_objects
from .visible_road import visible_road

GROUPS = ("ego", "objects", "road", "lights", "stop_signs")
# Nocturne shows a sign before it is in the cone. In its stored outputs all signs do
# that were up to 1.94 m away from the cone, and none that was 2.06 m away or more.
SIGN_RADIUS = 2.0  # metres
# Nocturne knows fewer kinds of map features, and numbers light states otherwise.
ROAD_KINDS = {
    "none": (),
    "lane": LANES,
    "line": tuple(range(MapType.LINE_UNKNOWN, MapType.EDGE_UNKNOWN)),
    "edge": EDGES,
    "stop_sign": (MapType.STOP_SIGN,),
    "crosswalk": (MapType.CROSSWALK,),
    "speed_bump": (MapType.SPEED_BUMP,),
    "other": (MapType.DRIVEWAY,),
}
LIGHT_STATES = (
    LightState.UNKNOWN,
    LightState.STOP,
    LightState.CAUTION,
    LightState.GO,
    LightState.ARROW_STOP,
    LightState.ARROW_CAUTION,
    LightState.ARROW_GO,
    LightState.FLASHING_STOP,
    LightState.FLASHING_CAUTION,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class NocturneConfig:
    """How far a viewer sees, and how much of that it is told.

    The defaults make the 6727 numbers of the paper; ten features of the ego and 20
    lights make the 6970 of the published program.
    """

    name: Literal["nocturne"] = "nocturne"
    view_angle: float = 2.1  # radians
    view_distance: float = 80.0  # metres
    num_objects: int = 16
    num_road: int = 500  # points
    num_lights: int = 0  # 0 leaves the lights out
    num_stop_signs: int = 4
    ego_features: Literal[7, 10] = 7  # ten: with the last action
    history: int = 0  # frames before the present one; in these nobody tilts the head

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a count is too small, the cone is empty or wider than a turn,
                or features of the ego are asked for that are not known.
        """
        ranges.require_at_least(
            self, num_objects=1, num_road=1, num_lights=0, num_stop_signs=1, history=0
        )
        if not 0 < self.view_angle <= 2 * math.pi:
            raise ValueError(
                f"view_angle must be above 0 and at most 2 pi, got {self.view_angle}."
            )
        if not 0 < self.view_distance < math.inf:
            raise ValueError(
                f"view_distance must be a positive length, got {self.view_distance}."
            )
        if self.ego_features not in (7, 10):
            raise ValueError(f"ego_features must be 7 or 10, got {self.ego_features}.")
        if self.history and self.ego_features == 10:
            raise ValueError(
                "ego_features must be 7 with a history: past actions are not known."
            )


# What N imitates with: half a turn in place of head tilt, and five frames (N A.1).
IMITATION = NocturneConfig(view_angle=math.pi, history=4)


def nocturne(config: NocturneConfig) -> Observer:
    """Builds the observer.

    The controls of the view must be acceleration, steering and, where they are three,
    head tilt: the angle from the heading to the axis of the cone.

    It departs from the published program in what says nothing: the direction of a
    vector without length, such as the velocity of one standing car relative to another,
    is 0 here, where Nocturne shows the heading of the viewer on the map. And a light
    that is not seen at a step is not shown, where Nocturne shows its next state.
    """

    def observe(view: View, number: Int[Array, ""]) -> Observation:
        tilt = jnp.zeros_like(view.motion.yaw[0, 0])
        if config.history == 0 and view.controls.shape[-1] > 2:
            tilt = view.controls[number, 2]

        def look(motion: Motion, step: Int[Array, ""]):
            lights = view.scene.lights_at(step)
            return _look(config, view, (motion, lights), number, tilt)

        steps = view.step - config.history + jnp.arange(config.history + 1)
        frames = jax.vmap(look)(view.motion, steps)
        return jax.tree.map(lambda leaf: jnp.swapaxes(leaf, 0, 1), frames)

    return Observer(config.history, observe, lambda: slots(config))


def flat(observation: Observation) -> Float[Array, " features"]:
    """Returns the published vector: all groups, one frame after the other."""
    frames = [
        jnp.swapaxes(observation[name].values, 0, 1).reshape(
            observation[name].values.shape[1], -1
        )
        for name in GROUPS
        if name in observation
    ]
    return jnp.concatenate(frames, axis=1).ravel()


def _look(config, view: View, world, number, tilt) -> Observation:
    """Returns what is seen in one frame, without the axis of frames."""
    motion, lights = world
    me = jax.tree.map(lambda leaf: leaf[number], motion)
    cone = Cone(
        xy=me.xy,
        yaw=me.yaw + tilt,
        angle=config.view_angle,
        distance=jnp.where(me.valid, config.view_distance, 0.0),
    )
    boxes = Boxes(motion.xy, motion.yaw, view.object_size, motion.valid)
    visible = visible_objects(boxes, number, cone)
    distance = geometry.norm(motion.xy - me.xy[None])
    order, shown = nearest(distance, visible, max(len(visible), config.num_objects))
    hiding = jax.tree.map(lambda leaf: leaf[order], boxes).replace(valid=shown)
    chosen = order[: config.num_objects], shown[: config.num_objects]

    road = visible_road(view.scene, hiding, cone, config.num_road)
    groups = {
        "ego": (_ego(config, view, me, number)[None], jnp.ones_like(shown[:1])),
        "objects": (_objects(view, motion, me, chosen[0]), chosen[1]),
        "road": (_road(view.scene.map_points(road[0]), me), road[1]),
        "stop_signs": _stop_signs(config, view.scene, me, cone),
    }
    if config.num_lights:
        groups["lights"] = _lights(config, lights, me, cone)
    return {
        name: TokenGroup(
            values=jnp.where((mask & me.valid)[:, None], values, 0.0),
            mask=mask & me.valid,
        )
        for name, (values, mask) in groups.items()
    }


def _ego(config, view: View, me: Motion, number):
    goal = jax.tree.map(lambda leaf: leaf[number], view.goal.motion)
    features = [
        *view.object_size[number, :2],
        signed_speed(me),
        *_polar(goal.xy - me.xy, me.yaw),
        geometry.wrap_angle(goal.yaw - me.yaw),
        signed_speed(goal) - signed_speed(me),
    ]
    if config.ego_features == 10:
        acceleration, steering, *tilt = view.controls[number, :3]
        features += [acceleration, steering, *(tilt or [jnp.zeros_like(steering)])]
    return jnp.stack(features)


def _objects(view: View, motion: Motion, me: Motion, chosen):
    them = jax.tree.map(lambda leaf: leaf[chosen], motion)
    push = _drive(them) - _drive(me)[None]
    speed, course = _polar(push, me.yaw)
    return stack(
        jnp.ones_like(speed),
        *_polar(them.xy - me.xy[None], me.yaw),
        view.object_size[chosen, :2],
        geometry.wrap_angle(them.yaw - me.yaw),
        course,
        speed,
        jax.nn.one_hot(view.scene.object_type[chosen], len(ObjectType)),
    )


def _road(points: Points, me: Motion):
    xy, next_xy = points.xyz[:, :2], points.next_xyz[:, :2]
    distance, bearing = _polar(xy - me.xy[None], me.yaw)
    kinds = jnp.asarray(_ROAD_KIND)[points.map_type]
    along = _polar(next_xy - xy, me.yaw)
    return stack(jnp.ones_like(distance), distance, bearing, *along, kinds)


def _lights(config, lights: Lights, me: Motion, cone: Cone):
    there = lights.valid & cone.contains(lights.xyz[:, :2])
    distance, bearing = _polar(lights.xyz[:, :2] - me.xy[None], me.yaw)
    chosen, mask = nearest(distance, there, config.num_lights)
    states = jnp.asarray(_LIGHT_STATE)[lights.state]
    seen = stack(jnp.ones_like(distance), distance, bearing, states)
    return seen[chosen], mask


def _stop_signs(config, scene: Scene, me: Motion, cone: Cone):
    signs = scene.stop_signs()
    offset = signs.xyz[:, :2] - me.xy[None]
    there = signs.valid & cone.touches(signs.xyz[:, :2], SIGN_RADIUS)
    chosen, mask = nearest(geometry.norm(offset), there, config.num_stop_signs)
    place = _polar(offset[chosen], me.yaw)
    return jnp.stack([jnp.ones_like(place[0]), *place], axis=-1), mask


def _polar(vector, yaw):
    """Returns length, and angle to a yaw; 0 where there is no length."""
    x, y = jnp.moveaxis(geometry.to_frame(vector, yaw), -1, 0)
    length = geometry.norm(vector)
    x = jnp.where(length > 0, x, 1.0)
    return length, geometry.angle(x, jnp.where(length > 0, y, 0.0))


def _drive(motion: Motion):
    """Returns the velocity as Nocturne has it, along the heading."""
    return signed_speed(motion)[..., None] * geometry.direction(motion.yaw)


_ROAD_KIND = one_hot_rows(ROAD_KINDS.values(), NUM_MAP_TYPES)
_LIGHT_STATE = one_hot_rows([(state,) for state in LIGHT_STATES], len(LightState))


_BEARING = -math.pi, math.pi
_PRESENT = ("is_present", "", 0.0, 1.0)
_SIZE = ("length", "1 m", 0.0, math.inf), ("width", "1 m", 0.0, math.inf)
_EGO = (
    *_SIZE,
    ("speed", "1 m/s", -math.inf, math.inf),
    ("goal_distance", "1 m", 0.0, math.inf),
    ("goal_bearing", "1 rad", *_BEARING),
    ("goal_heading", "1 rad", *_BEARING),
    ("goal_speed", "1 m/s", -math.inf, math.inf),
    ("acceleration", "1 m/s^2", -math.inf, math.inf),
    ("steering", "1 rad", -math.inf, math.inf),
    ("head_tilt", "1 rad", -math.inf, math.inf),
)


def _place(far: float):
    return ("distance", "1 m", 0.0, far), ("bearing", "1 rad", *_BEARING)


def _kinds(names: Iterable[str]):
    return tuple((f"is_{name}", "", 0.0, 1.0) for name in names)


def slots(config: NocturneConfig) -> tuple[Slot, ...]:
    """Returns what the features of each group are."""
    far = config.view_distance
    named = {
        "ego": _EGO[: config.ego_features],
        "objects": (
            _PRESENT,
            *_place(math.inf),  # of a centre; the cone may hold no more than a corner
            *_SIZE,
            ("heading", "1 rad", *_BEARING),
            ("course", "1 rad", *_BEARING),
            ("relative_speed", "1 m/s", 0.0, math.inf),
            *_kinds(kind.name.lower() for kind in ObjectType),
        ),
        "road": (
            _PRESENT,
            *_place(far),
            ("next_distance", "1 m", 0.0, math.inf),
            ("next_bearing", "1 rad", *_BEARING),
            *_kinds(ROAD_KINDS),
        ),
        "lights": (
            _PRESENT,
            *_place(far),
            *_kinds(state.name.lower() for state in LIGHT_STATES),
        ),
        "stop_signs": (_PRESENT, *_place(far + SIGN_RADIUS)),
    }
    if not config.num_lights:
        del named["lights"]
    return tuple(
        Slot(group=group, feature=feature, unit=unit, low=low, high=high)
        for group, features in named.items()
        for feature, unit, low, high in features
    )
