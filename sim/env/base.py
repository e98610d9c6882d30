"""States what an environment is: pure functions over a bank and a state."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from ..data.bank import Bank
from ..dynamics.base import Dynamics
from ..goals import Goal
from ..metrics.base import Measure
from ..motion import Motion
from ..observations.base import Observation
from ..records import Record
from ..scene import Scene

# In planning an ActionSpec and an Action; in multi-agent a tuple of them, one a team.
Spec = Any
Act = Any

# Of the scene as an episode begins: its `current_step` is the episode's first.
Controls = Callable[[Scene], Bool[Array, " objects"]]


@dataclasses.dataclass(frozen=True)
class Team:
    """Objects that move by the same dynamics, each by an action of its own."""

    dynamics: Dynamics
    controls: Controls  # says who they are, once an episode


class State(Record):
    """A world: which scenario it plays, and all that changes."""

    index: Int[Array, ""]  # of the scenario in the bank
    step: Int[Array, ""]  # of the scenario
    motion: Motion
    history: Motion  # of the steps before, oldest first, with a leading axis
    object_size: Float[Array, "objects 3"]  # metres; constant in an episode
    sim_agent: Any  # what the sim agent remembers
    goal: Goal  # constant in an episode
    teams: tuple[Bool[Array, " objects"], ...]  # whom each controls; constant too
    removable: Bool[Array, " objects"]  # whose part may end early; constant too
    admitted: Bool[Array, " objects"]  # may be there: not removed, not too late
    controls: Float[Array, "objects features"]  # of the last actions; coasting at first
    key: PRNGKeyArray  # constant in an episode; views fold their step into it

    @property
    def controlled(self) -> Bool[Array, " objects"]:
        """Whom the teams control, be they there or not."""
        return jnp.any(jnp.stack(self.teams), axis=0)


class Timestep(Record):
    """What a step gives: to the ego in planning, to each object in multi-agent.

    Who did not act gets no reward and no valid measure.
    """

    acted: Bool[Array, "*objects"]  # was there before the step, under control
    reward: Float[Array, "*objects"]  # of the state after the action
    discount: Float[Array, "*objects"]  # of what follows; 0 where terminated or settled
    terminated: Bool[Array, "*objects"]  # the task itself has ended, or never was
    truncated: Bool[Array, ""]  # the log ends here
    measures: dict[str, Measure]  # after the action


@dataclasses.dataclass(frozen=True)
class Environment:
    """A task. What is controlled acts; sim agents drive all others."""

    action_spec: Spec
    reset: Callable[[Bank, Int[Array, ""], PRNGKeyArray], State]
    step: Callable[[Bank, State, Act], tuple[State, Timestep]]
    observe: Callable[[Bank, State], Observation]  # in multi-agent of each actor
    # The most actors of a world in multi-agent (`controlled.actors`); None: everyone.
    max_actors: int | None = None


@dataclasses.dataclass(frozen=True)
class Driver:
    """Whoever chooses the actions.

    `reset(scene)` prepares its memory for an episode that begins at the `current_step`
    of the scene, `act(memory, bank, state, key)` returns the memory and an action.
    """

    reset: Callable[[Scene], Any]
    act: Callable[[Any, Bank, State, PRNGKeyArray], tuple[Any, Act]]
