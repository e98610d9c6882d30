"""Shows what the expert of the log did: observations with the action that followed."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from ..data.bank import Bank
from ..data.stratum import Stratum
from ..dynamics.base import Action, Dynamics
from ..goals import logged_goal
from ..metrics.build import EGO
from ..motions import object_of
from ..observations.base import Observation, Observer, View
from ..records import Record
from ..scene import Scene


class Demonstration(Record):
    """One step of the expert."""

    observation: Observation
    action: Action
    weight: Float[Array, ""]  # 0 where the log lacks the ego before or after the step


Sample = Callable[[Bank, Stratum, PRNGKeyArray], Demonstration]


def demonstrations(dynamics: Dynamics, observer: Observer) -> Sample:
    """Builds the function that draws one demonstration of a bank.

    A scenario of the stratum and a simulated step are drawn uniformly; the observation
    is that of the log, the action the inverse dynamics between two logged motions.
    """
    history = observer.history

    def sample(bank: Bank, stratum: Stratum, key: PRNGKeyArray) -> Demonstration:
        scenario_key, step_key, view_key = jax.random.split(key, 3)
        index = stratum.draw(bank, scenario_key)
        scene = Scene(bank=bank, index=index)
        step = jax.random.randint(step_key, (), scene.current_step, scene.num_steps - 1)
        seen = jax.vmap(scene.log_at)(step - history + jnp.arange(history + 1))
        now = jax.tree.map(lambda leaf: leaf[-1], seen)
        here, there = object_of(now, EGO), object_of(scene.log_at(step + 1), EGO)
        view = View(
            scene=scene,
            step=step,
            motion=seen,
            object_size=scene.object_size,
            goal=logged_goal(scene, scene.log_at(scene.current_step)),
            controls=dynamics.controls(dynamics.coast(now, bank.dt)),
            key=view_key,
        )
        return Demonstration(
            observation=observer.observe(view, jnp.int32(EGO)),
            action=dynamics.inverse(here, there, view.object_size[EGO], bank.dt),
            weight=(here.valid & there.valid).astype(jnp.float32),
        )

    return sample
