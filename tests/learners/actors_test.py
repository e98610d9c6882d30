"""Tests who acts: an episode is the same, however many seats its world has."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.learners import acting, actors
from drivetrain.learners.acting import Cast
from drivetrain.sim import rewards
from drivetrain.sim.data.stratum import Stratum
from drivetrain.sim.env import controlled
from drivetrain.sim.env.base import Environment, Team
from drivetrain.sim.env.multi_agent import MultiAgentConfig, multi_agent
from drivetrain.sim.env.rollout import rollout
from drivetrain.sim.metrics.collision import COLLISION
from drivetrain.sim.metrics.displacement import DISPLACEMENT
from drivetrain.sim.scenario import ObjectType
from drivetrain.sim.sim_agents.playback import PLAYBACK
from tests import worlds
from tests.learners.opponents_test import BLIND, SPACE, counting_agent

BUSY = 0  # a generated scenario with all kinds of objects, of whom some join late
RIDERS = controlled.of_type(ObjectType.PEDESTRIAN, ObjectType.CYCLIST)
FEW = 8  # seats, some of them empty
NUM_STEPS = 12


def environment(max_actors: int | None) -> Environment:
    return multi_agent(
        (Team(SPACE, RIDERS),),
        PLAYBACK,
        BLIND,
        rewards.weighted({"log_displacement": -1.0}),
        (COLLISION, DISPLACEMENT),
        MultiAgentConfig(max_actors=max_actors),
    )


def riders() -> np.ndarray:
    (numbers,) = np.nonzero(RIDERS(worlds.scene(worlds.bank("generated"), BUSY)))
    assert 1 < len(numbers) < FEW
    return numbers


def test_an_agent_drives_the_same_from_few_seats() -> None:
    bank, key = worlds.bank("generated"), jax.random.key(0)

    def motion(max_actors: int | None):
        env = environment(max_actors)
        driver = acting.greedy(counting_agent(), env)(jnp.float32(1.0), jnp.int32(0))
        play = jax.jit(lambda: rollout(env, driver, bank, jnp.int32(BUSY), key).motion)
        return play()

    few, all_ = motion(FEW), motion(None)
    jax.tree.map(np.testing.assert_array_equal, few, all_)
    logged = jax.vmap(worlds.scene(bank, BUSY).log_at)(11 + jnp.arange(NUM_STEPS))
    gap = np.abs(logged.xyz - few.xyz[:NUM_STEPS])[:, riders(), :2].max(axis=(0, 2))
    assert (gap > 0.1).sum() > 2  # of those who are there


def test_a_learner_gets_of_each_seat_what_its_object_gets() -> None:
    bank, params = worlds.bank("generated"), jnp.float32(1.0)
    busy = Stratum(first=jnp.int32(BUSY), stride=1000)
    begin = jax.vmap(acting.begin, in_axes=(None, None, None, 0))

    def steps(max_actors: int | None) -> acting.Step:
        cast = Cast(environment(max_actors), counting_agent(), acting.likeliest)

        @jax.jit
        def play(keys):
            world = begin(cast, bank, busy, keys)
            spread = jax.tree.map(lambda leaf: leaf[None], busy)
            return acting.unroll(cast, params, bank, spread, world, keys, NUM_STEPS)[1]

        return jax.device_get(play(jax.random.key(0)[None]))

    few, all_ = steps(FEW), steps(None)
    numbers = riders()
    for name in ("observation", "action", "reward", "discount", "mask", "measures"):
        jax.tree.map(
            lambda own, every: np.testing.assert_array_equal(
                own[:, 0, : len(numbers)], every[:, 0, numbers]
            ),
            getattr(few, name),
            getattr(all_, name),
        )
    assert few.mask[:, 0, : len(numbers)].any() and (few.reward < -0.1).any()
    assert not few.mask[:, 0, len(numbers) :].any()
    assert not few.reward[:, 0, len(numbers) :].any()


def test_what_is_told_of_objects_and_actors_fits_together() -> None:
    env = environment(FEW)
    state = env.reset(worlds.bank("generated"), jnp.int32(BUSY), jax.random.key(0))
    numbers, count = riders(), len(state.admitted)
    (given,) = actors.act(env, state, jnp.arange(1, FEW + 1))
    expected = np.zeros(count, int)
    expected[numbers] = 1 + np.arange(len(numbers))
    np.testing.assert_array_equal(given, expected)
    back = actors.of_actors(env, state, {"action": given, "there": given > 0})
    seated = np.arange(FEW) < len(numbers)
    np.testing.assert_array_equal(back["there"], seated)
    np.testing.assert_array_equal(
        back["action"], np.where(seated, 1 + np.arange(FEW), 0)
    )
