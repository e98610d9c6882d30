"""States what an agent is: pure functions of its parameters and one observation."""

import dataclasses
from collections.abc import Callable

import jax
from jaxtyping import Array, Float, Key, PyTree

from ..sim.observations.base import Observation
from ..sim.records import Record
from .distributions import ActionValues, Distribution
from .plan import Planned

Params = PyTree[Array]
Memory = PyTree[Array]


class Output(Record):
    """What an agent makes of an observation."""

    # Over actions in the environment's own units: its `mode()` drives when evaluating;
    # where it is a distribution, its `sample(key)` explores.
    policy: Distribution | ActionValues | Planned
    value: Float[Array, ""]  # the expected return; zero where the agent has no critic


@dataclasses.dataclass(frozen=True, kw_only=True)
class Agent:
    """A policy without its parameters.

    `init(key)` draws parameters. `memory()` is what it remembers before the first step
    of an episode, nothing for most. `step(params, memory, observation)` is what it
    remembers after an observation, and what it makes of it.
    """

    init: Callable[[Key[Array, ""]], Params]
    memory: Callable[[], Memory]
    step: Callable[[Params, Memory, Observation], tuple[Memory, Output]]

    @property
    def remembers(self) -> bool:
        """Whether anything is left of an observation for the next step."""
        return bool(jax.tree.leaves(jax.eval_shape(self.memory)))
