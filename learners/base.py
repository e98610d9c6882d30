"""States what a learner is: a pure update of a train state from a bank of scenarios."""

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import optax
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int, Key, PyTree

from ..agents.base import Params
from ..sim.records import Record

Bank = PyTree[Array]  # one device's share of the data


class Mean(Record):
    """A mean that can be taken over more: the sum, and what to divide it by."""

    total: Float[Array, ""]
    weight: Float[Array, ""]


Metrics = dict[str, Mean]


def one(value: ArrayLike) -> Mean:
    """Returns a number as the mean of itself."""
    return Mean(total=jnp.asarray(value, jnp.float32), weight=jnp.float32(1.0))


class TrainState(Record):
    """Everything that an update changes.

    Inside a program a device sees its own worlds, `[strata of the device, ...]`;
    outside they are those of all devices. All else is the same on all of them.
    """

    params: Params
    opt_state: optax.OptState
    step: Int[Array, ""]  # updates done
    key: Key[Array, ""]
    kept: PyTree[Array] = ()  # what the learner remembers besides, such as a target
    worlds: PyTree[Array] = ()  # where it acts and what it replays, by stratum


@dataclasses.dataclass(frozen=True, kw_only=True)
class Learner:
    """A pair of pure functions, which run on each device of a mesh axis.

    `init(key, bank, axis_name)` is the state before the first update, and
    `update(train_state, bank, axis_name)` the state after one more, with metrics. Both
    see that device's share of the bank, and return the same on all devices but for the
    worlds.
    """

    init: Callable[[Key[Array, ""], Bank, str], TrainState]
    update: Callable[[TrainState, Bank, str], tuple[TrainState, Metrics]]
