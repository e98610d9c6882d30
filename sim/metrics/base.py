"""States what a metric is: a function of one object at one step."""

import dataclasses
from collections.abc import Callable, Collection, Mapping

import jax.numpy as jnp
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


def is_any_positive(
    measures: Mapping[str, Measure], names: Collection[str]
) -> Bool[Array, "*objects"]:
    """Tells whether one of some metrics is, such as of those that end a task."""
    is_any = jnp.bool_(False)
    for name in names:
        is_any |= measures[name].valid & (measures[name].value > 0)
    return is_any


def only(
    measures: Mapping[str, Measure], mask: Bool[Array, "*objects"]
) -> dict[str, Measure]:
    """Returns measures that are valid of those of a mask alone."""
    return {
        name: measure.replace(valid=measure.valid & mask)
        for name, measure in measures.items()
    }


@dataclasses.dataclass(frozen=True)
class Metric:
    """A named measure of one object in a moment; all objects by vmap.

    Metrics are not differentiable where they count events.
    """

    name: str
    ego_only: bool  # needs the ego's paths
    measure: Callable[[Moment, Int[Array, ""]], Measure]
