"""Tests that sequences are cut as they were played, and are gone through as then."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Output
from drivetrain.agents.distributions import ActionValues
from drivetrain.learners import acting, sequences
from drivetrain.learners.sequences import Sequence
from drivetrain.learners.stage import Played
from drivetrain.sim.data.stratum import Stratum
from tests.learners import crowd, probes, recurrent

NUM_STEPS, NUM_WORLDS = 11, 4
AGENT = recurrent.gru_agent()
PARAMS = AGENT.init(jax.random.key(1))
ROUNDING = 1e-5  # the same sums in another order, of numbers of order one


@functools.cache
def played(several: bool) -> Played:
    """Plays, from the middle of episodes on."""
    env = crowd.environment() if several else probes.environment(probes.MEMORY)
    bank = jax.tree.map(lambda leaf: leaf[0], probes.bank(1))
    stratum = Stratum(first=jnp.zeros(NUM_WORLDS, jnp.int32), stride=1)
    keys = jax.random.split(jax.random.key(2), NUM_WORLDS)
    cast = acting.Cast(env, AGENT, sequences.explore)
    begin = jax.vmap(functools.partial(acting.begin, cast, bank))

    @functools.partial(jax.jit, static_argnums=2)
    def unroll(worlds, keys, num_steps):
        return acting.unroll(cast, PARAMS, bank, stratum, worlds, keys, num_steps)

    before, _ = unroll(begin(stratum, keys), keys, 2)
    after, steps = unroll(before, jax.vmap(jax.random.fold_in)(keys, jnp.arange(4)), 11)
    return Played(before=before, steps=steps, after=after)


def whole(several: bool) -> Sequence:
    return jax.jit(sequences.of_actors)(played(several))


@pytest.mark.parametrize("several", [False, True])
def test_an_agent_makes_of_its_steps_what_it_did_when_acting(several: bool) -> None:
    found = whole(several)
    num_axes = 2 if several else 1
    assert float(jnp.abs(found.memory).max()) > 0.1  # some is left from before

    def recall(sequence: Sequence):
        output, log_ratio = sequences.recall(AGENT, PARAMS, sequence)
        return output.value, log_ratio

    value, log_ratio = jax.jit(sequences.each(recall, num_axes))(found)
    # Also of the steps that show how an episode ended.
    np.testing.assert_allclose(value, found.note.value, atol=ROUNDING)
    np.testing.assert_allclose(log_ratio, 0, atol=ROUNDING)
    assert not np.asarray(found.mask).all() and np.asarray(found.mask).any()


def test_each_actor_has_its_own_row() -> None:
    found, steps = whole(True), played(True).steps
    for world in range(NUM_WORLDS):
        for actor in range(crowd.NUM_ACTORS):
            place = (slice(None), world, actor)
            own = found.action[world, actor], found.mask[world, actor]
            np.testing.assert_array_equal(own[0], steps.action[place])
            np.testing.assert_array_equal(own[1], steps.mask[place])


@pytest.mark.parametrize("several", [False, True])
def test_units_are_worlds_or_single_steps(several: bool) -> None:
    actors = (crowd.NUM_ACTORS,) if several else ()
    grid = np.meshgrid(*map(np.arange, (4, *actors, NUM_STEPS)), indexing="ij")
    names = jnp.array(np.stack(grid, axis=-1))  # world, (actor,) step
    worlds = sequences.units(names, 2, len(actors), by_step=False)
    np.testing.assert_array_equal(
        worlds, names.reshape(2, 2, *actors, NUM_STEPS, names.shape[-1])
    )
    steps = np.asarray(sequences.units(names, 2, len(actors), by_step=True))
    assert steps.shape == (2, 2 * NUM_STEPS, *actors, 1, names.shape[-1])
    for stratum in range(2):
        for unit in range(2 * NUM_STEPS):
            one = steps[stratum, unit].reshape(-1, names.shape[-1])
            # One world of the stratum, one step, every actor.
            assert (one[:, 0] == 2 * stratum + unit // NUM_STEPS).all()
            assert (one[:, -1] == unit % NUM_STEPS).all()
            if several:
                np.testing.assert_array_equal(one[:, 1], np.arange(*actors))


def test_an_agent_of_action_values_is_refused() -> None:
    output = Output(policy=ActionValues(values=jnp.zeros(2)), value=jnp.zeros(()))
    with pytest.raises(TypeError, match="must draw its actions"):
        sequences.explore(output, jax.random.key(0))
