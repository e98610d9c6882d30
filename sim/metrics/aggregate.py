"""Adds the metrics of the steps of an episode up (`definitions.md` section 7)."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..records import Record
from .base import Measure

FLAGS = (
    "collision",
    "offroad",
    "offroute",
    "kinematic",
    "wrong_way",
    "red_light",
    "edge_contact",
    "goal",
)


class Episode(Record):
    """The figures of one episode of one object; zero where not valid."""

    value: dict[str, Float[Array, ""]]
    valid: dict[str, Bool[Array, ""]]


def summarize(steps: dict[str, Measure]) -> Episode:
    """Returns an episode's figures from measures with a leading axis of steps.

    `FLAGS`: 1 if flagged at any valid step. `log_ade`, `log_fde`: the displacement, its
    mean over valid steps and at the last. `progress`: the ratio at the last valid step.
    What was not measured has no figure.
    """
    figures = {name: _any(steps[name]) for name in FLAGS if name in steps}
    if "log_displacement" in steps:
        figures["log_ade"] = _mean(steps["log_displacement"])
        figures["log_fde"] = _last(steps["log_displacement"])
    if "progress" in steps:
        figures["progress"] = _last(steps["progress"])
    return Episode(
        value={name: figure.value for name, figure in figures.items()},
        valid={name: figure.valid for name, figure in figures.items()},
    )


def _any(steps: Measure) -> Measure:
    flagged = jnp.any((steps.value > 0) & steps.valid)
    return Measure(value=flagged.astype(jnp.float32), valid=jnp.any(steps.valid))


def _mean(steps: Measure) -> Measure:
    count = jnp.sum(steps.valid)
    total = jnp.sum(jnp.where(steps.valid, steps.value, 0.0))
    return Measure(value=total / jnp.maximum(count, 1), valid=count > 0)


def _last(steps: Measure) -> Measure:
    numbers = jnp.arange(len(steps.valid))
    last = jnp.argmax(jnp.where(steps.valid, numbers, -1))
    valid = steps.valid[last]
    return Measure(value=jnp.where(valid, steps.value[last], 0.0), valid=valid)
