"""Drives vehicles by the intelligent driver model (Treiber et al. 2000; W 3.5)."""

import dataclasses
import math
from dataclasses import field

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .. import box_search, geometry
from ..box_search import Boxes
from ..motion import Motion
from ..scenario import ObjectType
from ..scene import Scene
from . import logged_path, stop_lights
from .base import Carry, SimAgent
from .logged_path import Follower
from .stop_lights import LightConfig


@dataclasses.dataclass(frozen=True, kw_only=True)
class IdmConfig:
    """The parameters of the model, named as in Treiber et al."""

    desired_speed: float = 30.0  # v0 [m/s]
    min_gap: float = 2.0  # s0 [m]
    time_gap: float = 2.0  # T [s]
    acceleration: float = 2.0  # a [m/s^2]
    deceleration: float = 4.0  # b [m/s^2], comfortable
    exponent: float = 4.0  # delta
    lookahead: float = 50.0  # metres along the way in which a leader is sought
    num_chords: int = 10  # straight pieces by which the way ahead is swept
    stops_at_lights: bool = False  # that are red
    lights: LightConfig = field(default_factory=LightConfig)

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a parameter is not positive and finite.
        """
        numbers = dataclasses.asdict(self)
        for name in ("stops_at_lights", "lights"):
            del numbers[name]
        for name, number in numbers.items():
            if not 0 < number < math.inf:
                raise ValueError(f"{name} of the IDM must be positive, got {number}.")

    @property
    def chord(self) -> float:
        """The length of a chord along the way [m]."""
        return self.lookahead / self.num_chords


MIN_GAP = 0.1  # metres; keeps the interaction finite in contact


def idm(config: IdmConfig) -> SimAgent:
    """Builds the sim agent.

    It drives vehicles that are there at the current step, move at least a metre later
    on and touch nobody at the start, along their logged way and past its end straight
    on. All others do what the log says. Which leader is met and how far ahead has no
    gradient; how fast both drive has one.
    """

    def reset(scene: Scene) -> Follower:
        follower = logged_path.follow(scene)
        motion = scene.log_at(scene.current_step)
        overlap = _overlaps(motion, scene.object_size)
        is_vehicle = scene.object_type == ObjectType.VEHICLE
        return follower.replace(
            is_driven=follower.is_driven & is_vehicle & ~jnp.any(overlap, axis=1)
        )

    def step(
        scene: Scene, carry: Carry, motion: Motion, step: Int[Array, ""]
    ) -> tuple[Carry, Motion]:
        acceleration = _acceleration(config, scene, carry, motion, step)
        return logged_path.advance(scene, carry, acceleration, scene.log_at(step + 1))

    return SimAgent("idm", reset, step)


def _overlaps(motion: Motion, size: Float[Array, "objects 3"]):
    overlap = geometry.boxes_overlap(
        motion.xy[:, None],
        motion.yaw[:, None],
        size[:, None],
        motion.xy[None],
        motion.yaw[None],
        size[None],
    )
    other = ~jnp.eye(len(motion.yaw), dtype=bool)
    return overlap & other & motion.valid[:, None] & motion.valid[None]


def _acceleration(
    config: IdmConfig,
    scene: Scene,
    follower: Follower,
    motion: Motion,
    step: Int[Array, ""],
) -> Float[Array, " objects"]:
    """Returns the acceleration of the model.

        dv/dt = a [1 - (v / v0)^delta - (s* / s)^2]

    A red light is a leader at rest. Of two leaders the one that brakes harder counts.
    """
    speed, size = follower.speed, scene.object_size
    stations = config.chord * jnp.arange(config.num_chords + 1)
    way, _ = follower.path.at(follower.arc[:, None] + stations[None])
    gap, leader_speed = _leader(way, follower.is_driven, config.chord, motion, size)
    interaction = _interaction(config, speed, gap, leader_speed)
    if config.stops_at_lights:
        red = jax.vmap(stop_lights.gap, in_axes=(None, None, 0, None, 0, 0))(
            config.lights,
            scene.lights_at(step),
            way,
            config.chord,
            size[:, 0] / 2,
            speed,
        )
        at_rest = _interaction(config, speed, red, jnp.zeros_like(speed))
        interaction = jnp.maximum(interaction, at_rest)
    free = 1 - (speed / config.desired_speed) ** config.exponent
    return config.acceleration * (free - interaction)


def _interaction(
    config: IdmConfig,
    speed: Float[Array, " objects"],
    gap: Float[Array, " objects"],
    leader_speed: Float[Array, " objects"],
) -> Float[Array, " objects"]:
    """Returns how much a leader brakes, zero without one, where the gap is infinite.

        (s* / s)^2,   s* = s0 + max(0, v T + v (v - v_l) / (2 sqrt(a b)))

    s is the gap to the leader and v_l its speed along the way.
    """
    braking = 2 * (config.acceleration * config.deceleration) ** 0.5
    approach = speed * config.time_gap + speed * (speed - leader_speed) / braking
    desired_gap = config.min_gap + jnp.maximum(approach, 0.0)
    return (desired_gap / jnp.maximum(gap, MIN_GAP)) ** 2


def _leader(
    way: Float[Array, "objects stations 2"],
    active: Bool[Array, " objects"],
    chord_spacing: float,
    motion: Motion,
    size: Float[Array, "objects 3"],
) -> tuple[Float[Array, " objects"], Float[Array, " objects"]]:
    """Finds the gap to the nearest box on each object's swept path, and its speed.

    The way ahead is swept by rectangles of the object's width over chords of the way.
    The gap reaches from the front of the object to the corner of the other box that
    comes first along the chord.

    Args:
        way: places at equal distances along each object's way, from where it is [m].
        active: whose leader is sought.
        chord_spacing: the distance between them along the way [m].
        motion: of all objects.
        size: of all objects [m].

    Returns:
        The gap [m], infinite without a leader, and the leader's speed along the way
        [m/s].
    """
    boxes = Boxes(xy=motion.xy, yaw=motion.yaw, size=size, valid=motion.valid)

    def sweep(number, active, way):
        met = box_search.first_contact(boxes, number, active, way, chord_spacing)
        along = way[met.chord + 1] - way[met.chord]
        heading = along / jnp.maximum(geometry.norm(along), 1e-6)
        gap = met.distance - size[number, 0] / 2
        return gap, geometry.dot(motion.velocity[met.box], heading)

    return jax.vmap(sweep)(jnp.arange(len(active)), active, way)
