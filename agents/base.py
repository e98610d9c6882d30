"""States what an agent is: pure functions of its parameters and one observation."""

import dataclasses
from collections.abc import Callable

from jaxtyping import Array, Key, PyTree

from ..sim.observations.base import Observation
from .distributions import Distribution

Params = PyTree[Array]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Agent:
    """A policy without its parameters.

    `init(key)` draws parameters. `distribution(params, observation)` is the policy's
    distribution over actions in the environment's own units: its `mode()` drives when
    evaluating, its `sample(key)` when exploring, its `log_prob(action)` when imitating.
    """

    init: Callable[[Key[Array, ""]], Params]
    distribution: Callable[[Params, Observation], Distribution]
