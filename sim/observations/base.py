"""States what an observation is: named groups of tokens, each with its mask."""

import dataclasses
from collections.abc import Callable

from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from ..goals import Goal
from ..motion import Motion
from ..records import Record
from ..scene import Scene


class View(Record):
    """A world as observations see it."""

    scene: Scene
    step: Int[Array, ""]  # the present one
    motion: Motion  # of the last steps up to the present, with a leading axis
    object_size: Float[Array, "objects 3"]  # length, width, height [m]
    goal: Goal
    controls: Float[Array, "objects features"]  # of the last actions; coasting at first
    key: PRNGKeyArray  # for noise


class TokenGroup(Record):
    """Things of one kind, each seen over some steps; a map feature has one step."""

    values: Float[Array, "tokens steps features"]  # zero where the mask is False
    mask: Bool[Array, "tokens steps"]  # True where the thing was there


Observation = dict[str, TokenGroup]


@dataclasses.dataclass(frozen=True)
class Observer:
    """Says what one object sees; all objects by vmap over their numbers."""

    history: int  # steps before the present one that are looked at
    observe: Callable[[View, Int[Array, ""]], Observation]
