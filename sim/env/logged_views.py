"""Draws moments of the log and shows them as an environment would."""

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from ..data.bank import Bank
from ..data.stratum import Stratum
from ..dynamics.base import Dynamics
from ..goals import logged_goal
from ..observations.base import Observer, View
from ..scene import Scene


def logged_view(
    dynamics: Dynamics,
    observer: Observer,
    bank: Bank,
    stratum: Stratum,
    key: PRNGKeyArray,
) -> View:
    """Draws a scenario of the stratum and a simulated step of it, both uniformly.

    Args:
        dynamics: say what coasting is, for those who look at the last actions.
        observer: says how many past steps are looked at.
        bank: the scenarios.
        stratum: those to draw from.
        key: of the draw, and of the noise of the view.

    Returns:
        The world as it was logged then; some step of the log follows.
    """
    scenario_key, step_key, view_key = jax.random.split(key, 3)
    scene = Scene(bank=bank, index=stratum.draw(bank, scenario_key))
    step = jax.random.randint(step_key, (), scene.current_step, scene.num_steps - 1)
    steps = step - observer.history + jnp.arange(observer.history + 1)
    seen = jax.vmap(scene.log_at)(steps)
    now = jax.tree.map(lambda leaf: leaf[-1], seen)
    return View(
        scene=scene,
        step=step,
        motion=seen,
        object_size=scene.object_size,
        goal=logged_goal(scene, scene.log_at(scene.current_step)),
        controls=dynamics.controls(dynamics.coast(now, bank.dt)),
        key=view_key,
    )
