"""Adds the metrics of the steps of an episode up (`definitions.md` section 7)."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..records import Record
from .base import Measure


class Episode(Record):
    """The figures of one episode of one object; zero where not valid."""

    value: dict[str, Float[Array, ""]]
    valid: dict[str, Bool[Array, ""]]


def summarize(steps: dict[str, Measure]) -> Episode:
    """Returns an episode's figures from measures with a leading axis of steps.

    Flags (collision, offroad, offroute, kinematic): 1 if flagged at any valid step.
    `log_ade`: the mean of the displacement over valid steps. `progress`: the ratio at
    the last valid step.
    """
    value, valid = {}, {}
    for name in ("collision", "offroad", "offroute", "kinematic"):
        value[name] = jnp.any((steps[name].value > 0) & steps[name].valid)
        valid[name] = jnp.any(steps[name].valid)
    displacement = steps["log_displacement"]
    count = jnp.sum(displacement.valid)
    total = jnp.sum(jnp.where(displacement.valid, displacement.value, 0.0))
    value["log_ade"] = total / jnp.maximum(count, 1)
    valid["log_ade"] = count > 0
    progress = steps["progress"]
    numbers = jnp.arange(len(progress.valid))
    last = jnp.argmax(jnp.where(progress.valid, numbers, -1))
    value["progress"] = jnp.where(progress.valid[last], progress.value[last], 0.0)
    valid["progress"] = progress.valid[last]
    return Episode(
        value={name: x.astype(jnp.float32) for name, x in value.items()}, valid=valid
    )
