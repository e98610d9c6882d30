"""Drives vehicles by the intelligent driver model (Treiber et al. 2000; W 3.5)."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .. import geometry
from ..motion import Motion
from ..scenario import ObjectType
from ..scene import Scene
from . import logged_path
from .base import Carry, SimAgent
from .logged_path import Follower


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

    @property
    def chord(self) -> float:
        """The length of a chord along the way [m]."""
        return self.lookahead / self.num_chords


MIN_GAP = 0.1  # metres; keeps the interaction finite in contact


def idm(config: IdmConfig) -> SimAgent:
    """Builds the sim agent.

    It drives vehicles that are there at the current step, move at least a metre later
    on and touch nobody at the start, along their logged way and past its end straight
    on. All others do what the log says.
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
        acceleration = _acceleration(config, scene, carry, motion)
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
    config: IdmConfig, scene: Scene, follower: Follower, motion: Motion
) -> Float[Array, " objects"]:
    """Returns the acceleration of the model.

        dv/dt = a [1 - (v / v0)^delta - (s* / s)^2]
        s* = s0 + max(0, v T + v (v - v_l) / (2 sqrt(a b)))

    s is the gap to the leader and v_l its speed along the way; the last term is zero
    without a leader.
    """
    gap, leader_speed = _leader(config, scene, follower, motion)
    speed = follower.speed
    braking = 2 * (config.acceleration * config.deceleration) ** 0.5
    approach = speed * config.time_gap + speed * (speed - leader_speed) / braking
    desired_gap = config.min_gap + jnp.maximum(approach, 0.0)
    free = 1 - (speed / config.desired_speed) ** config.exponent
    return config.acceleration * (free - (desired_gap / gap) ** 2)


def _leader(
    config: IdmConfig, scene: Scene, follower: Follower, motion: Motion
) -> tuple[Float[Array, " objects"], Float[Array, " objects"]]:
    """Finds the gap to the nearest box on each object's swept path, and its speed.

    The way ahead is swept by rectangles of the object's width over chords of the way.
    The gap reaches from the front of the object to the corner of the other box that
    comes first along the chord.

    Returns:
        The gap [m], infinite without a leader, and the leader's speed along the way
        [m/s].
    """
    stations = config.chord * jnp.arange(config.num_chords + 1)
    place, _ = follower.path.at(follower.arc[:, None] + stations[None])
    size = scene.object_size
    corners = geometry.box_corners(motion.xy, motion.yaw, size)
    numbers = jnp.arange(len(motion.yaw))

    def sweep(number, place, width, length):
        start, along = place[:-1], jnp.diff(place, axis=0)
        chord_length = geometry.norm(along)
        heading = along / jnp.maximum(chord_length, 1e-6)[:, None]
        chord_size = jnp.stack(
            [chord_length, jnp.full_like(chord_length, width)], axis=-1
        )
        hit = geometry.boxes_overlap(
            (start + along / 2)[:, None],
            jnp.arctan2(heading[:, 1], heading[:, 0])[:, None],
            chord_size[:, None],
            motion.xy[None],
            motion.yaw[None],
            size[None],
        )
        ahead = jnp.einsum("jkc,mc->mjk", corners, heading).min(axis=-1)
        ahead = jnp.maximum(ahead - geometry.dot(start, heading)[:, None], 0.0)
        is_other = motion.valid & (numbers != number)
        contact = stations[:-1, None] + ahead
        contact = jnp.where(hit & is_other[None], contact, jnp.inf)
        chord, leader = jnp.unravel_index(jnp.argmin(contact), contact.shape)
        gap = jnp.maximum(contact[chord, leader] - length / 2, MIN_GAP)
        return gap, geometry.dot(motion.velocity[leader], heading[chord])

    return jax.vmap(sweep)(numbers, place, size[:, 1], size[:, 0])
