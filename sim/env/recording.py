"""Records an episode whole: every object at every step, with every metric."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from ..data.bank import Bank
from ..metrics.base import Measure, Moment
from ..metrics.build import measure_all
from ..motion import Motion
from ..records import Record
from ..scene import Scene
from .base import Driver, Environment
from .rollout import play


class Recording(Record):
    """All steps of a scenario: logged ones up to the start, then simulated."""

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
    reset_key, key = jax.random.split(key)
    state = env.reset(bank, index, reset_key)
    played = play(env, driver, bank, state, key).motion
    simulated = jax.tree.map(
        lambda start, later: jnp.concatenate([start[None], later]), state.motion, played
    )
    scene = Scene(bank=bank, index=index)
    steps = jnp.arange(bank.sizes.num_steps)
    log = jax.vmap(scene.log_at)(steps)
    is_simulated = steps >= state.step
    place = jnp.clip(steps - state.step, 0, bank.sizes.num_simulated)
    motion = jax.tree.map(
        lambda logged, simulated: jnp.where(
            is_simulated.reshape(-1, *[1] * (logged.ndim - 1)), simulated[place], logged
        ),
        log,
        simulated,
    )
    motion = motion.replace(
        valid=motion.valid & (steps < scene.num_steps)[:, None],
    )
    before = jax.tree.map(lambda leaf: jnp.roll(leaf, 1, axis=0), motion)
    before = before.replace(valid=before.valid.at[0].set(False))

    def measure(step, before, after, logged):
        return measure_all(
            Moment(
                scene=scene,
                object_size=state.object_size,
                step=step,
                before=before,
                after=after,
                logged=logged,
                goal=state.goal,
            )
        )

    return Recording(
        motion=motion,
        measures=jax.lax.map(lambda xs: measure(*xs), (steps, before, motion, log)),
    )
