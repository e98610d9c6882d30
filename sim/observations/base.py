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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Slot:
    """One feature of the tokens of a group."""

    group: str
    feature: str  # unique in its group
    unit: str  # for what the value 1 stands, such as `20 m`; empty for pure numbers
    low: float  # no value is below, that of absent tokens, 0, included
    high: float  # no value is above; infinite where nothing bounds it


@dataclasses.dataclass(frozen=True)
class Observer:
    """Says what one object sees; all objects by vmap over their numbers.

    `observe(view, number)` is what the object of that number sees. `describe()` names
    what stands in it: the slots of a group, in their order, are the features of its
    tokens, in all its tokens and at all their steps.
    """

    history: int  # steps before the present one that are looked at
    observe: Callable[[View, Int[Array, ""]], Observation]
    describe: Callable[[], tuple[Slot, ...]]
