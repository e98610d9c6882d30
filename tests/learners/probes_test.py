"""Tests that the probe worlds are what they are said to be."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Output
from drivetrain.agents.distributions import Categorical
from drivetrain.learners import acting
from drivetrain.learners.acting import Step
from drivetrain.sim.data.stratum import Stratum
from tests.learners import probes

NUM_WORLDS, NUM_STEPS = 4, 24


@functools.partial(jax.jit, static_argnums=0)
def played(probe: probes.Probe) -> Step:
    """Plays with random actions."""
    env = probes.environment(probe)
    agent = probes.linear_agent(
        lambda values: Output(policy=Categorical(logits=values), value=jnp.zeros(())), 2
    )
    bank = jax.tree.map(lambda leaf: leaf[0], probes.bank(1))
    strata = Stratum(first=jnp.zeros(NUM_WORLDS, jnp.int32), stride=1)
    keys = jax.random.split(jax.random.key(1), NUM_WORLDS)
    cast = acting.Cast(env, agent, lambda output, key: (output.policy.sample(key), ()))
    begin = jax.vmap(functools.partial(acting.begin, cast, bank))
    params = agent.init(jax.random.key(2))
    _, steps = acting.unroll(
        cast, params, bank, strata, begin(strata, keys), keys, NUM_STEPS
    )
    return steps


@pytest.mark.parametrize(
    "probe", [probes.VALUE, probes.BOOTSTRAPPING, probes.TRUNCATION, probes.MEMORY]
)
def test_episodes_have_their_steps_and_one_to_show_the_end(probe: probes.Probe) -> None:
    steps = played(probe)
    period = probe.num_steps + 1
    place = np.arange(NUM_STEPS) % period
    each = np.repeat(place[:, None], NUM_WORLDS, axis=1)
    np.testing.assert_array_equal(steps.mask, each < probe.num_steps)
    np.testing.assert_array_equal(steps.ended, each == probe.num_steps - 1)
    terminates = steps.ended & (not probe.truncates)
    np.testing.assert_array_equal(
        np.asarray(steps.discount)[steps.mask], 1.0 - terminates[steps.mask]
    )


def test_the_reward_of_memory_is_told_by_what_was_seen_first() -> None:
    steps = played(probes.MEMORY)
    sign = np.asarray(steps.observation["coin"].values)[..., 0, 0, -1]
    action, reward = np.asarray(steps.action), np.asarray(steps.reward)
    for start in range(0, NUM_STEPS, 4):
        np.testing.assert_array_equal(np.abs(sign[start]), 1)
        np.testing.assert_array_equal(sign[start + 1 : start + 4], 0)
        right = action[start + 2] == (sign[start] > 0)
        np.testing.assert_array_equal(reward[start + 2], right)
        np.testing.assert_array_equal(reward[start : start + 2], 0)
