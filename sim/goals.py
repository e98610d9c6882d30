"""States where objects want to be: where the log last saw them."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from . import geometry
from .dynamics.speed import signed_speed
from .motion import Motion
from .records import Record
from .scene import Scene


class Gap(NamedTuple):
    """How far one object is from its goal; nothing is negative."""

    distance: Float[Array, ""]  # metres
    speed: Float[Array, ""]  # metres per second
    heading: Float[Array, ""]  # radians, at most pi


class Goal(Record):
    """The goals of all objects, constant in an episode (N 3.1)."""

    motion: Motion  # the last valid logged one
    distance: Float[Array, " objects"]  # from the start [m]; 0 for who joins later

    def gap(self, motion: Motion, number: Int[Array, ""]) -> Gap:
        """Returns how far an object is from its goal, with finite gradients.

        Speeds count as negative backwards.
        """
        goal = self.motion
        turn = geometry.wrap_angle(motion.yaw[number] - goal.yaw[number])
        speed = signed_speed(motion)[number] - signed_speed(goal)[number]
        return Gap(
            distance=geometry.norm(motion.xy[number] - goal.xy[number]),
            speed=jnp.abs(speed),
            heading=jnp.abs(turn),
        )


def logged_goal(scene: Scene, start: Motion) -> Goal:
    """Returns the goals of an episode.

    Args:
        scene: the scenario.
        start: the motion with which the episode begins.
    """
    end = scene.log_end()
    distance = geometry.norm(end.xy - start.xy)
    return Goal(motion=end, distance=jnp.where(start.valid, distance, 0.0))
