"""Plays whole episodes in one program."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from ..data.bank import Bank
from ..data.stratum import Stratum
from ..metrics.base import Measure
from ..motion import Motion
from ..records import Record
from .base import Act, Driver, Environment, State, Timestep
from .starts import StartScene


class Rollout(Record):
    """The steps of an episode, with a leading axis of steps.

    The figures of the episode are `aggregate.summarize(measures)`; in multi-agent those
    of each object are `jax.vmap(aggregate.summarize, in_axes=1)(measures)`.
    """

    action: Act  # that was taken
    motion: Motion  # after each step
    reward: Float[Array, "*steps"]  # zero after the end of the log
    measures: dict[str, Measure]  # of the ego or of each object; likewise not valid
    valid: Bool[Array, " steps"]  # False after the end of the log


def rollout(
    env: Environment,
    driver: Driver,
    bank: Bank,
    index: Int[Array, ""],
    key: PRNGKeyArray,
) -> Rollout:
    """Plays one scenario from the start of an episode to the end of its log.

    The number of steps is that of the longest log of the bank; shorter ones are masked.
    """
    reset_key, key = jax.random.split(key)
    return play(env, driver, bank, env.reset(bank, index, reset_key), key)


def play(
    env: Environment, driver: Driver, bank: Bank, state: State, key: PRNGKeyArray
) -> Rollout:
    """Plays a world from the start of its episode on, as `rollout` does."""
    scene = StartScene(bank=bank, index=state.index, start=state.step, key=state.key)
    num_steps = scene.num_steps

    def step(carry, key):
        state, memory = carry
        memory, action = driver.act(memory, bank, state, key)
        following, timestep = env.step(bank, state, action)
        valid = following.step < num_steps
        measures = {
            name: measure.replace(valid=measure.valid & valid)
            for name, measure in timestep.measures.items()
        }
        out = Rollout(
            action=action,
            motion=following.motion,
            reward=jnp.where(valid, timestep.reward, 0.0),
            measures=measures,
            valid=valid,
        )
        return (following, memory), out

    keys = jax.random.split(key, bank.sizes.num_simulated)
    _, steps = jax.lax.scan(step, (state, driver.reset(scene)), keys)
    return steps


def has_ended(timestep: Timestep) -> Bool[Array, ""]:
    """Tells whether an episode ended: with its log, or with nobody left to act."""
    return timestep.truncated | jnp.all(timestep.terminated)


def begin(env: Environment, bank: Bank, stratum: Stratum, key: PRNGKeyArray) -> State:
    """Returns a world at the start of an episode in a random scenario of a stratum."""
    index_key, reset_key = jax.random.split(key)
    return env.reset(bank, stratum.draw(bank, index_key), reset_key)
