"""Follows the way an object took in the log, at any speed."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .. import geometry
from ..motion import Motion
from ..records import Record
from ..scene import Scene

MIN_REACH = 1.0  # metres; objects that never get farther away stay with the log


class LoggedPath(Record):
    """The logged ways of all objects from the current step on.

    Steps at which an object was not there repeat the last place before.
    """

    xy: Float[Array, "objects steps 2"]  # metres
    yaw: Float[Array, "objects steps"]  # radians
    arc: Float[Array, "objects steps"]  # from the current step on [m]
    ends_backwards: Bool[Array, " objects"]  # whether the last metre was reversed
    is_driven: Bool[Array, " objects"]  # there at the current step, and moves on

    def at(
        self, arc: Float[Array, "objects stations"]
    ) -> tuple[Float[Array, "objects stations 2"], Float[Array, "objects stations"]]:
        """Returns place and yaw at arc lengths.

        Linear between logged steps, and straight on after the end: along the last yaw,
        or against it where the log ends backwards.

        Args:
            arc: from the start of each object's way, not negative [m].
        """
        xy, yaw = jax.vmap(_interpolate)(self.xy, self.yaw, self.arc, arc)
        beyond = jnp.maximum(arc - self.arc[:, -1:], 0.0)
        beyond = jnp.where(self.ends_backwards[:, None], -beyond, beyond)
        return xy + beyond[..., None] * geometry.direction(yaw), yaw


def _interpolate(xy, yaw, arc, station):
    """Interpolates between steps, and stays at the last one after the end."""
    last = len(arc) - 1
    start = jnp.sum(arc[None] <= station[:, None], axis=-1) - 1
    end = jnp.minimum(start + 1, last)
    length = arc[end] - arc[start]
    share = (station - arc[start]) / jnp.where(length > 0, length, 1.0)
    share = jnp.where(length > 0, share, 0.0)
    turn = geometry.wrap_angle(yaw[end] - yaw[start])
    station_yaw = geometry.wrap_angle(yaw[start] + share * turn)
    return xy[start] + share[:, None] * (xy[end] - xy[start]), station_yaw


def logged_path(scene: Scene) -> LoggedPath:
    """Gathers the logged ways of all objects of a scenario."""
    steps = scene.current_step + jnp.arange(scene.bank.sizes.num_steps)
    log = jax.vmap(scene.log_at)(steps)
    numbers = jnp.arange(len(steps))[:, None]
    latest = jax.lax.cummax(jnp.where(log.valid, numbers, 0), axis=0)
    xy = jnp.take_along_axis(log.xy, latest[..., None], axis=0)
    yaw = jnp.take_along_axis(log.yaw, latest, axis=0)
    start = log.valid[0]
    moved = geometry.norm(jnp.diff(xy, axis=0, prepend=xy[:1]))
    arc = jnp.cumsum(jnp.where(start[None], moved, 0.0), axis=0)
    # Not the length of the way: noise makes metres of it for parked cars.
    reach = jnp.max(geometry.norm(xy - xy[:1]), axis=0)
    xy, yaw, arc = jnp.swapaxes(xy, 0, 1), yaw.T, arc.T
    near_end = jnp.maximum(arc[:, -1:] - 1.0, 0.0)
    before, _ = jax.vmap(_interpolate)(xy, yaw, arc, near_end)
    last_metre = xy[:, -1] - before[:, 0]
    return LoggedPath(
        xy=xy,
        yaw=yaw,
        arc=arc,
        ends_backwards=geometry.dot(last_metre, geometry.direction(yaw[:, -1])) < 0,
        is_driven=start & (reach >= MIN_REACH),
    )


class Follower(Record):
    """Objects on their logged ways, each at its own speed."""

    path: LoggedPath
    arc: Float[Array, " objects"]  # passed since the current step [m]
    speed: Float[Array, " objects"]  # metres per second
    is_driven: Bool[Array, " objects"]  # the others stay with the log


def follow(scene: Scene) -> Follower:
    """Puts all objects on their logged ways, with the speed of the current step."""
    path = logged_path(scene)
    motion = scene.log_at(scene.current_step)
    return Follower(
        path=path,
        arc=jnp.zeros_like(motion.yaw),
        speed=motion.speed,
        is_driven=path.is_driven,
    )


def advance(
    scene: Scene,
    follower: Follower,
    acceleration: Float[Array, " objects"],
    logged: Motion,
) -> tuple[Follower, Motion]:
    """Moves driven objects along their ways, and the others as in the log.

        v' = max(0, v + a dt),   s' = s + (v + v') dt / 2

    The velocity points along the yaw, and against it where the way leads backwards.

    Args:
        scene: the scenario.
        follower: before the step.
        acceleration: of the step [m/s^2].
        logged: the log one step later, where the others and all heights come from.
    """
    dt = scene.bank.dt
    speed = jnp.maximum(follower.speed + acceleration * dt, 0.0)
    arc = follower.arc + (follower.speed + speed) / 2 * dt
    places, yaws = follower.path.at(jnp.stack([follower.arc, arc], axis=1))
    xy, yaw, heading = places[:, 1], yaws[:, 1], geometry.direction(yaws[:, 1])
    is_back = geometry.dot(xy - places[:, 0], heading) < 0
    signed_speed = jnp.where(is_back, -speed, speed)
    driven = follower.is_driven
    moved = Motion(
        xyz=jnp.where(
            driven[:, None],
            jnp.concatenate([xy, logged.xyz[:, 2:]], axis=-1),
            logged.xyz,
        ),
        yaw=jnp.where(driven, yaw, logged.yaw),
        velocity=jnp.where(
            driven[:, None], signed_speed[:, None] * heading, logged.velocity
        ),
        valid=logged.valid | driven,
    )
    return follower.replace(arc=arc, speed=speed), moved
