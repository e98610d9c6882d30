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
Experience = PyTree[Array]  # what a learner learns from, of one device


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


# Of a train state and the bank, the state some updates later and the metrics of each.
Program = Callable[[TrainState, Bank], tuple[TrainState, Metrics]]


def replace_params(train_state: TrainState, params: Params) -> TrainState:
    """Returns the train state with other parameters, and all else as it was."""
    return train_state.replace(params=params)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Learner:
    """Pure functions, which run on each device of a mesh axis.

    `init(key, bank, axis_name)` is the state before the first update. An update acts,
    then learns: `act(train_state, bank, axis_name)` gathers experience, and
    `learn(train_state, experience, bank, axis_name)` gives the state after one more
    update, with metrics. All see that device's share of the bank, and return the same
    on all devices but for worlds and experience. `adopt(train_state, params)` is the
    state before the first update of one who begins with other parameters.
    """

    init: Callable[[Key[Array, ""], Bank, str], TrainState]
    act: Callable[[TrainState, Bank, str], tuple[TrainState, Experience]]
    learn: Callable[[TrainState, Experience, Bank, str], tuple[TrainState, Metrics]]
    adopt: Callable[[TrainState, Params], TrainState] = replace_params

    def update(
        self, train_state: TrainState, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        """Acts and learns."""
        train_state, experience = self.act(train_state, bank, axis_name)
        return self.learn(train_state, experience, bank, axis_name)
