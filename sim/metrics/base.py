"""States what a metric is: a function of one object at one step."""

import dataclasses
from collections.abc import Callable

from jaxtyping import Array, Bool, Float, Int

from ..goals import Goal
from ..motion import Motion
from ..records import Record
from ..scene import Scene


class Moment(Record):
    """What happened in one step of a world."""

    scene: Scene
    object_size: Float[Array, "objects 3"]  # length, width, height [m]
    step: Int[Array, ""]  # the step after
    before: Motion
    after: Motion
    logged: Motion  # at the step after
    goal: Goal


class Measure(Record):
    """The value of a metric; without meaning where not valid."""

    value: Float[Array, ""]
    valid: Bool[Array, ""]


@dataclasses.dataclass(frozen=True)
class Metric:
    """A named measure of one object in a moment; all objects by vmap.

    Metrics are not differentiable where they count events.
    """

    name: str
    ego_only: bool  # needs the ego's paths
    measure: Callable[[Moment, Int[Array, ""]], Measure]
