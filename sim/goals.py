"""States where objects want to be: where the log last saw them."""

from jaxtyping import Array, Float

from . import geometry
from .motion import Motion
from .records import Record
from .scene import Scene


class Goal(Record):
    """The goals of all objects, constant in an episode (N 3.1)."""

    motion: Motion  # the last valid logged one
    distance: Float[Array, " objects"]  # from the start of the episode [m]


def logged_goal(scene: Scene, start: Motion) -> Goal:
    """Returns the goals of an episode.

    Args:
        scene: the scenario.
        start: the motion with which the episode begins.
    """
    end = scene.log_end()
    return Goal(motion=end, distance=geometry.norm(end.xy - start.xy))
