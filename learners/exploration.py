"""Takes random actions now and then, ever fewer, to see what else is worth it."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from ..agents.base import Output
from ..sim import ranges
from ..sim.dynamics.base import Action
from .acting import Choose


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExplorationConfig:
    """How many actions are random."""

    initial_epsilon: float = 1.0  # share of random actions
    final_epsilon: float = 0.05
    exploration_steps: int = 1_000_000  # of the environment, from the one to the other

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if shares do not fall within 0 and 1, or there are no steps.
        """
        ranges.require_at_least(self, exploration_steps=1)
        if not 0 <= self.final_epsilon <= self.initial_epsilon <= 1:
            raise ValueError(
                f"final_epsilon and initial_epsilon must be from 0 to 1 in this order, "
                f"got {self.final_epsilon} and {self.initial_epsilon}."
            )


def epsilon(
    config: ExplorationConfig, num_env_steps: Int[Array, ""]
) -> Float[Array, ""]:
    """Returns the share of random actions: falls along a line, then stays."""
    done = jnp.minimum(num_env_steps / config.exploration_steps, 1.0)
    return config.initial_epsilon + done * (
        config.final_epsilon - config.initial_epsilon
    )


def greedy(epsilon: Float[Array, ""], num_actions: int) -> Choose:
    """Takes the best action, or with probability epsilon any, each as likely."""

    def choose(output: Output, key: Key[Array, ""]) -> tuple[Action, tuple]:
        chance_key, action_key = jax.random.split(key)
        is_random = jax.random.uniform(chance_key) < epsilon
        anything = jax.random.randint(action_key, (), 0, num_actions)
        return jnp.where(is_random, anything, output.policy.mode()), ()

    return choose
