"""States what an environment is: pure functions over a bank and a state."""

import dataclasses
from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from ..data.bank import Bank
from ..dynamics.base import Action, ActionSpec
from ..goals import Goal
from ..metrics.base import Measure
from ..motion import Motion
from ..observations.base import Observation
from ..records import Record
from ..scene import Scene


class State(Record):
    """A world: which scenario it plays, and all that changes."""

    index: Int[Array, ""]  # of the scenario in the bank
    step: Int[Array, ""]  # of the scenario
    motion: Motion
    history: Motion  # of the steps before, oldest first, with a leading axis
    object_size: Float[Array, "objects 3"]  # metres; constant in an episode
    sim_agent: Any  # what the sim agent remembers
    goal: Goal  # constant in an episode
    controls: Float[Array, "objects features"]  # of the last actions; coasting at first
    key: PRNGKeyArray


class Timestep(Record):
    """What a step gives: to the ego in planning, to each object in multi-agent."""

    reward: Float[Array, "*objects"]  # of the state after the action
    discount: Float[Array, "*objects"]  # of what follows; 0 where terminated
    terminated: Bool[Array, "*objects"]  # the task itself has ended
    truncated: Bool[Array, ""]  # the log ends here
    measures: dict[str, Measure]  # after the action


@dataclasses.dataclass(frozen=True)
class Environment:
    """A task. What is controlled acts; sim agents drive all others."""

    action_spec: ActionSpec
    reset: Callable[[Bank, Int[Array, ""], PRNGKeyArray], State]
    step: Callable[[Bank, State, Action], tuple[State, Timestep]]
    observe: Callable[[Bank, State], Observation]


@dataclasses.dataclass(frozen=True)
class Driver:
    """Whoever chooses the ego's actions.

    `reset(scene)` prepares its memory for an episode, `act(memory, bank, state, key)`
    returns the memory and an action.
    """

    reset: Callable[[Scene], Any]
    act: Callable[[Any, Bank, State, PRNGKeyArray], tuple[Any, Action]]
