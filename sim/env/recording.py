"""Records an episode whole: every object at every step, with every metric."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from ..data.bank import Bank
from ..goals import logged_goal
from ..metrics.base import Measure, Moment
from ..metrics.build import measure_all
from ..motion import Motion
from ..records import Record
from ..scene import Scene
from .base import Driver, Environment
from .rollout import rollout


class Recording(Record):
    """All steps of a scenario: logged ones up to the current step, then simulated."""

    motion: Motion  # with a leading axis of steps
    measures: dict[str, Measure]  # [steps, objects]; [steps] where only for the ego


def record(
    env: Environment,
    driver: Driver,
    bank: Bank,
    index: Int[Array, ""],
    key: PRNGKeyArray,
) -> Recording:
    """Plays a scenario and measures all its objects at all its steps.

    Metrics that look at a step and the one before are not valid at the first step.
    """
    scene = Scene(bank=bank, index=index)
    played = rollout(env, driver, bank, index, key).motion
    steps = jnp.arange(bank.sizes.num_steps)
    log = jax.vmap(scene.log_at)(steps)
    is_simulated = steps > scene.current_step
    place = jnp.clip(steps - scene.current_step - 1, 0, bank.sizes.num_simulated - 1)
    motion = jax.tree.map(
        lambda logged, simulated: jnp.where(
            is_simulated.reshape(-1, *[1] * (logged.ndim - 1)), simulated[place], logged
        ),
        log,
        played,
    )
    motion = motion.replace(
        valid=motion.valid & (steps < scene.num_steps)[:, None],
    )
    before = jax.tree.map(lambda leaf: jnp.roll(leaf, 1, axis=0), motion)
    before = before.replace(valid=before.valid.at[0].set(False))
    size = scene.object_size
    goal = logged_goal(scene, scene.log_at(scene.current_step))

    def measure(step, before, after, logged):
        return measure_all(
            Moment(
                scene=scene,
                object_size=size,
                step=step,
                before=before,
                after=after,
                logged=logged,
                goal=goal,
            )
        )

    return Recording(
        motion=motion,
        measures=jax.lax.map(lambda xs: measure(*xs), (steps, before, motion, log)),
    )
