"""States what a learner is: a pure update of a train state from a bank of scenarios."""

import dataclasses
from collections.abc import Callable

import optax
from jaxtyping import Array, Float, Int, Key, PyTree

from ..agents.base import Params
from ..sim.records import Record

Bank = PyTree[Array]  # one device's share of the data
Metrics = dict[str, Float[Array, ""]]


class TrainState(Record):
    """Everything that an update changes."""

    params: Params
    opt_state: optax.OptState
    step: Int[Array, ""]  # updates done
    key: Key[Array, ""]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Learner:
    """A pair of pure functions.

    `init(key)` is the state before the first update.
    `update(train_state, bank, axis_name)` is the state after one more, and metrics. It
    runs on each device of a mesh axis with that device's share of the bank, and returns
    the same on all of them.
    """

    init: Callable[[Key[Array, ""]], TrainState]
    update: Callable[[TrainState, Bank, str], tuple[TrainState, Metrics]]
