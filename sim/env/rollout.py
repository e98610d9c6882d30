"""Plays whole episodes in one program."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from ..data.bank import Bank
from ..metrics.base import Measure
from ..motion import Motion
from ..records import Record
from ..scene import Scene
from .base import Driver, Environment, State, Timestep


class Rollout(Record):
    """The steps of an episode, with a leading axis of steps."""

    motion: Motion  # after each step
    measures: dict[str, Measure]  # of the ego; not valid after the end of the log
    valid: Bool[Array, " steps"]  # False after the end of the log


def rollout(
    env: Environment,
    driver: Driver,
    bank: Bank,
    index: Int[Array, ""],
    key: PRNGKeyArray,
) -> Rollout:
    """Plays one scenario from its current step to the end of its log.

    The number of steps is that of the longest log of the bank; shorter ones are masked.
    """

    def step(carry, key):
        state, memory = carry
        memory, action = driver.act(memory, bank, state, key)
        following, timestep = env.step(bank, state, action)
        valid = following.step < num_steps
        measures = {
            name: measure.replace(valid=measure.valid & valid)
            for name, measure in timestep.measures.items()
        }
        out = Rollout(motion=following.motion, measures=measures, valid=valid)
        return (following, memory), out

    scene = Scene(bank=bank, index=index)
    num_steps = scene.num_steps
    reset_key, key = jax.random.split(key)
    state = env.reset(bank, index, reset_key)
    keys = jax.random.split(key, bank.sizes.num_simulated)
    _, steps = jax.lax.scan(step, (state, driver.reset(scene)), keys)
    return steps


def step_or_reset(
    env: Environment, bank: Bank, state: State, timestep: Timestep, key: PRNGKeyArray
) -> State:
    """Returns the state, or a fresh one in a random scenario where the episode ended.

    Args:
        env: the environment.
        bank: its scenarios.
        state: after the step that gave `timestep`.
        timestep: tells whether the episode ended.
        key: chooses the next scenario.
    """
    ended = timestep.truncated | jnp.all(timestep.terminated)
    index_key, reset_key = jax.random.split(key)
    index = jax.random.randint(index_key, (), 0, bank.num_scenarios)
    fresh = env.reset(bank, index, reset_key)
    return jax.tree.map(lambda new, old: jnp.where(ended, new, old), fresh, state)
