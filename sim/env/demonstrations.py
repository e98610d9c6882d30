"""Shows what the expert of the log did: observations with the action that followed."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from ..data.bank import Bank
from ..dynamics.base import Action, Dynamics
from ..metrics.build import EGO
from ..observations.base import Observation
from ..observations.vector import Observe
from ..records import Record
from ..scene import Scene
from .planning import object_of


class Demonstration(Record):
    """One step of the expert."""

    observation: Observation
    action: Action
    weight: Float[Array, ""]  # 0 where the log lacks the ego before or after the step


Sample = Callable[[Bank, PRNGKeyArray], Demonstration]


def demonstrations(dynamics: Dynamics, observe: Observe, history: int) -> Sample:
    """Builds the function that draws one demonstration of a bank.

    A scenario and a simulated step are drawn uniformly; the observation is that of the
    log, the action the inverse dynamics between two logged motions.
    """

    def sample(bank: Bank, key: PRNGKeyArray) -> Demonstration:
        scenario_key, step_key = jax.random.split(key)
        index = jax.random.randint(scenario_key, (), 0, bank.num_scenarios)
        scene = Scene(bank=bank, index=index)
        step = jax.random.randint(step_key, (), scene.current_step, scene.num_steps - 1)
        seen = jax.vmap(scene.log_at)(step - history + jnp.arange(history + 1))
        here = object_of(jax.tree.map(lambda leaf: leaf[-1], seen), EGO)
        there = object_of(scene.log_at(step + 1), EGO)
        return Demonstration(
            observation=observe(scene, seen, scene.object_size, step),
            action=dynamics.inverse(here, there, bank.dt),
            weight=(here.valid & there.valid).astype(jnp.float32),
        )

    return sample
