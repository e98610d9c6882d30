"""Tests of the planning task: what a step changes, and what it leaves alone."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import rewards
from drivetrain.sim.data.stratum import whole
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import drivers
from drivetrain.sim.env.base import Environment
from drivetrain.sim.env.planning import planning
from drivetrain.sim.env.rollout import Rollout, begin, has_ended, rollout
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.sim_agents import build as sim_agents
from tests import worlds

HISTORY = 4
SMALL = VectorConfig(
    history=HISTORY, num_objects=3, num_road=4, num_lights=2, num_route=3
)
# Delta actions are differences of float32 positions up to 300 m, added up over 80
# steps: 80 rounding errors of 3e-5 m at most.
DRIFT = 3e-3


def env_of(dynamics_name: str, sim_agent: str = "playback") -> Environment:
    return planning(
        dynamics.build(dynamics_name),
        sim_agents.build(sim_agent),
        vector(SMALL),
        rewards.weighted(rewards.SPARSE),
    )


@functools.cache
def played(dynamics_name: str, driver: str, index: int) -> Rollout:
    env, bank = env_of(dynamics_name), worlds.bank("generated")
    player = drivers.build(driver, dynamics.build(dynamics_name))
    play = jax.jit(lambda bank, i, key: rollout(env, player, bank, i, key))
    return play(bank, jnp.int32(index), jax.random.key(0))


def test_reset_shows_the_log_up_to_the_current_step() -> None:
    bank = worlds.bank("generated")
    state = env_of("delta").reset(bank, jnp.int32(1), jax.random.key(0))
    scene = worlds.scene(bank, 1)
    for past in range(HISTORY):
        logged = worlds.log_at(scene, state.step - HISTORY + past)
        seen = jax.tree.map(lambda leaf, past=past: leaf[past], state.history)
        for a, b in zip(jax.tree.leaves(seen), jax.tree.leaves(logged), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("index", [0, 3])
def test_the_expert_with_delta_dynamics_repeats_the_log(index: int) -> None:
    steps = played("delta", "expert", index)
    displacement = steps.measures["log_displacement"]
    assert bool(displacement.valid.all())
    assert float(displacement.value.max()) < DRIFT


def test_others_follow_the_log_whatever_the_ego_does() -> None:
    steps = played("bicycle", "coast", 2)
    scene = worlds.scene(worlds.bank("generated"), 2)
    logged = worlds.log_at(scene, scene.current_step + 30)
    np.testing.assert_array_equal(steps.motion.valid[29, 1:], logged.valid[1:])
    np.testing.assert_array_equal(steps.motion.xyz[29, 1:], logged.xyz[1:])


def test_coasting_holds_velocity_and_yaw() -> None:
    steps = played("bicycle", "coast", 2)
    np.testing.assert_array_equal(
        steps.motion.yaw[:, 0], np.repeat(steps.motion.yaw[:1, 0], 80)
    )
    np.testing.assert_allclose(
        steps.motion.velocity[-1, 0], steps.motion.velocity[0, 0], rtol=1e-5
    )


def test_the_ego_stays_valid_and_keeps_the_height_of_the_log() -> None:
    steps = played("bicycle", "coast", 2)
    scene = worlds.scene(worlds.bank("generated"), 2)
    assert bool(steps.motion.valid[:, 0].all())
    for step in (0, 40, 79):
        logged = worlds.log_at(scene, scene.current_step + 1 + step)
        assert float(steps.motion.xyz[step, 0, 2]) == float(logged.xyz[0, 2])


def test_the_reward_is_that_of_the_state_after_the_action() -> None:
    env, bank = env_of("delta"), worlds.bank("generated")
    step = jax.jit(env.step)
    state = env.reset(bank, jnp.int32(0), jax.random.key(0))
    _, calm = step(bank, state, jnp.zeros(3))
    # A jump of 200 m to the side leaves every generated road.
    _, jumped = step(bank, state, jnp.array([0.0, 200.0, 0.0]))
    assert float(calm.reward) == 0.0
    assert float(jumped.measures["offroad"].value) == 1.0
    assert float(jumped.reward) <= -1.0


def test_an_episode_is_truncated_at_the_last_logged_step_only() -> None:
    env, bank = env_of("delta"), worlds.bank("generated")
    step = jax.jit(env.step)
    state = env.reset(bank, jnp.int32(0), jax.random.key(0))
    for expected in (False, True):
        state = state.replace(step=jnp.int32(88 if not expected else 89))
        _, timestep = step(bank, state, jnp.zeros(3))
        assert bool(timestep.truncated) is expected
        assert float(timestep.discount) == 1.0


def test_history_shifts_by_one_step() -> None:
    env, bank = env_of("delta"), worlds.bank("generated")
    state = env.reset(bank, jnp.int32(0), jax.random.key(0))
    following, _ = jax.jit(env.step)(bank, state, jnp.zeros(3))
    np.testing.assert_array_equal(following.history.xyz[:-1], state.history.xyz[1:])
    np.testing.assert_array_equal(following.history.xyz[-1], state.motion.xyz)


def test_episodes_end_with_the_log_and_begin_anywhere() -> None:
    env, bank = env_of("delta"), worlds.bank("generated")
    state = env.reset(bank, jnp.int32(0), jax.random.key(0)).replace(step=jnp.int32(60))
    state, timestep = jax.jit(env.step)(bank, state, jnp.zeros(3))
    assert not has_ended(timestep)
    assert has_ended(timestep.replace(truncated=jnp.array(True)))
    indices = set()
    for seed in range(20):
        fresh = begin(env, bank, whole(), jax.random.key(seed))
        assert int(fresh.step) == 10
        indices.add(int(fresh.index))
    assert len(indices) > 3


def test_a_batch_of_rollouts_equals_one_by_one() -> None:
    env, bank = env_of("bicycle", "idm"), worlds.bank("generated")
    driver = drivers.build("coast", dynamics.build("bicycle"))

    def play(index):
        return rollout(env, driver, bank, index, jax.random.key(0)).motion.xyz

    together = jax.jit(jax.vmap(play))(jnp.arange(2))
    for index in range(2):
        # The same operations in another order of vectorisation.
        np.testing.assert_allclose(
            together[index], jax.jit(play)(jnp.int32(index)), atol=DRIFT
        )


def test_an_unknown_agent_is_named_with_the_nearest_known_one() -> None:
    with pytest.raises(ValueError, match=r"'exprt'; did you mean 'expert'\?"):
        drivers.build("exprt", dynamics.build("delta"))
