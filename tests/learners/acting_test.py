"""Tests of playing on in many worlds, where episodes begin anew as others go on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import acting
from drivetrain.sim.data import stratum
from drivetrain.sim.env.base import State
from tests.learners import dqn_test, probes


@pytest.mark.parametrize("num_worlds", [1, 15, 16, 37])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_those_that_ended_begin_anew_and_no_others(
    num_worlds: int, share: float
) -> None:
    env, agent = probes.environment(probes.MEMORY), dqn_test.agent()
    cast = acting.Cast(env, agent, acting.likeliest)
    bank = jax.tree.map(lambda leaf: leaf[0], probes.bank(1))
    params = agent.init(jax.random.key(0))
    ended = np.random.default_rng(num_worlds).random(num_worlds) < share

    def world(state: State, ended: jax.Array) -> acting.World:
        return acting.World(state=state, memory=agent.memory(), ended=ended)

    # All have played one step, in a scenario that none of the bank is.
    played = probes.state(1, 0.5)
    worlds = jax.vmap(world, in_axes=(None, 0))(
        played.replace(index=jnp.int32(-1)), jnp.asarray(ended)
    )
    strata = jax.vmap(lambda _: stratum.whole())(jnp.arange(num_worlds))
    keys = jax.random.split(jax.random.key(1), num_worlds)
    after, steps = jax.jit(acting.unroll, static_argnums=(0, 6))(
        cast, params, bank, strata, worlds, keys, 1
    )
    np.testing.assert_array_equal(after.state.step, np.where(ended, 0, 2))
    np.testing.assert_array_equal(np.asarray(after.state.index) < 0, ~ended)
    np.testing.assert_array_equal(
        np.abs(after.state.sim_agent), np.where(ended, 1, 0.5)
    )
    np.testing.assert_array_equal(steps.mask[0], ~ended)
    assert not np.asarray(after.ended)[ended].any()
    if ended.sum() > 10:
        assert len(np.unique(np.asarray(after.state.index)[ended])) > 1
