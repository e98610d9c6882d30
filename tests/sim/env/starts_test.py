"""Tests of stochastic starts: who is off the log, by how much, and when they begin."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import controlled, drivers
from drivetrain.sim.env.base import Environment, State, Team
from drivetrain.sim.env.multi_agent import MultiAgentConfig, multi_agent
from drivetrain.sim.env.planning import planning
from drivetrain.sim.env.recording import record
from drivetrain.sim.env.rollout import rollout
from drivetrain.sim.env.starts import StartConfig
from drivetrain.sim.metrics.displacement import DISPLACEMENT
from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.sim_agents import build as sim_agents
from tests import worlds

NUM_STARTS = 2000
BLIND = vector(VectorConfig(history=1, num_objects=1, num_road=1, num_lights=0))
NOISY = StartConfig(position_noise=0.5, yaw_noise=0.1, speed_noise=2.0)
# The standard deviation of 2000 draws strays by 1.6 %; this is four times as much.
SAMPLING = 0.064
# Rounding of 10 m/s: noise turns the velocity with the yaw, so none is across it [m/s].
SLIP = 1e-5
# A reward of 1 for each step, and one metric.
PARTS = (lambda moment, number, measures: jnp.float32(1.0)), (DISPLACEMENT,)


def env_of(config: StartConfig, sim_agent: str = "playback") -> Environment:
    space, others = dynamics.build("delta"), sim_agents.build(sim_agent)
    return planning(space, others, BLIND, *PARTS, config)


@functools.cache
def begun(config: StartConfig, sim_agent: str = "playback") -> State:
    """Returns many starts of one scenario."""
    env, bank = env_of(config, sim_agent), worlds.bank("generated")
    keys = jax.random.split(jax.random.key(0), NUM_STARTS)
    reset = jax.jit(jax.vmap(env.reset, in_axes=(None, None, 0)))
    return jax.device_get(reset(bank, jnp.int32(0), keys).replace(key=()))


def log_at(steps: np.ndarray) -> Motion:
    scene = worlds.scene(worlds.bank("generated"), 0)
    return jax.device_get(jax.vmap(scene.log_at)(jnp.asarray(steps)))


def test_noise_has_the_deviations_of_the_config() -> None:
    motion, log = begun(NOISY).motion, log_at(np.array([10]))
    shift = motion.xyz[:, 0] - log.xyz[:, 0]
    np.testing.assert_allclose(shift[:, :2].std(axis=0), 0.5, rtol=SAMPLING)
    np.testing.assert_array_equal(shift[:, 2], 0)
    turn = motion.yaw[:, 0] - log.yaw[:, 0]
    np.testing.assert_allclose(turn.std(), 0.1, rtol=SAMPLING)
    along = np.stack([np.cos(motion.yaw[:, 0]), np.sin(motion.yaw[:, 0])], axis=-1)
    speed = (motion.velocity[:, 0] * along).sum(axis=-1)
    np.testing.assert_allclose(speed.std(), 2.0, rtol=SAMPLING)
    across = motion.velocity[:, 0, 1] * along[:, 0]
    across -= motion.velocity[:, 0, 0] * along[:, 1]
    assert np.ptp(across) < SLIP
    assert np.abs(np.corrcoef([*shift[:, :2].T, turn, speed]) - np.eye(4)).max() < 0.1


def test_only_the_controlled_are_off_the_log() -> None:
    state, log = begun(NOISY), log_at(np.array([10]))
    for leaf, logged in zip(
        jax.tree.leaves(state.motion), jax.tree.leaves(log), strict=True
    ):
        np.testing.assert_array_equal(
            leaf[:, 1:], np.broadcast_to(logged[:, 1:], leaf[:, 1:].shape)
        )
    past = log_at(np.array([9]))
    np.testing.assert_array_equal(state.history.xyz, np.stack([past.xyz] * NUM_STARTS))


def test_the_distance_to_the_goal_is_that_of_the_noisy_start() -> None:
    state = begun(NOISY)
    away = state.goal.motion.xyz[:, 0, :2] - state.motion.xyz[:, 0, :2]
    np.testing.assert_allclose(
        state.goal.distance[:, 0], np.linalg.norm(away, axis=-1), rtol=1e-5
    )


def test_each_step_up_to_the_latest_is_as_likely() -> None:
    state = begun(StartConfig(latest=4))
    counts = np.bincount(state.step)
    assert len(counts) == 15 and not counts[:10].any()
    # Five times the deviation of a binomial count of 400 among 2000.
    np.testing.assert_allclose(counts[10:], 400, atol=5 * 18)
    for leaf, logged in zip(
        jax.tree.leaves(state.motion), jax.tree.leaves(log_at(state.step)), strict=True
    ):
        np.testing.assert_array_equal(leaf, logged)


def test_a_step_is_left_of_each_episode() -> None:
    assert begun(StartConfig(latest=1000)).step.max() == 89


def test_a_late_start_where_the_ego_is_absent_is_put_off_to_the_current_step() -> None:
    bank, env = worlds.bank("generated"), env_of(StartConfig(latest=79))
    ego = bank.first_object[0]
    is_even = jnp.uint32(0x55555555)
    holey = bank.replace(valid_bits=bank.valid_bits.at[ego].set(is_even))
    keys = jax.random.split(jax.random.key(0), 100)
    reset = jax.jit(jax.vmap(env.reset, in_axes=(None, None, 0)))
    steps = np.asarray(reset(holey, jnp.int32(0), keys).step)
    assert len(np.unique(steps)) > 10 and not (steps % 2).any()


def test_sim_agents_begin_where_and_as_fast_as_the_log_then_is() -> None:
    follower = begun(StartConfig(latest=30), "constant_speed").sim_agent
    step = begun(StartConfig(latest=30)).step
    log = log_at(step)
    assert step.max() == 40
    start = follower.path.xy[:, :, 0]
    np.testing.assert_array_equal(start[log.valid], log.xyz[..., :2][log.valid])
    speed = np.linalg.norm(log.velocity, axis=-1)
    np.testing.assert_allclose(follower.speed, speed, rtol=1e-6)


def test_an_episode_that_starts_late_ends_with_its_log_and_is_recorded_so() -> None:
    bank, env = worlds.bank("generated"), env_of(StartConfig(latest=60))
    driver = drivers.build("expert", dynamics.build("delta"))
    key, index = jax.random.key(3), jnp.int32(0)
    steps = jax.jit(lambda: rollout(env, driver, bank, index, key))()
    recording = jax.jit(lambda: record(env, driver, bank, index, key))()
    num_steps = int(steps.valid.sum())
    assert 20 <= num_steps < 80 and steps.valid[:num_steps].all()
    assert not steps.measures["log_displacement"].valid[num_steps:].any()
    np.testing.assert_array_equal(steps.reward, steps.valid)
    np.testing.assert_array_equal(
        recording.motion.xyz[91 - num_steps :], steps.motion.xyz[:num_steps]
    )
    np.testing.assert_array_equal(
        recording.motion.xyz[: 91 - num_steps],
        log_at(np.arange(91 - num_steps)).xyz,
    )


def test_many_objects_start_off_the_log_each_by_itself() -> None:
    bank = worlds.bank("generated")
    env = multi_agent(
        (Team(dynamics.build("delta"), controlled.vehicles),),
        sim_agents.build("playback"),
        BLIND,
        *PARTS,
        MultiAgentConfig(starts=NOISY),
    )
    state = env.reset(bank, jnp.int32(2), jax.random.key(0))
    log = worlds.log_at(worlds.scene(bank, 2), jnp.int32(10))
    shift = np.asarray(state.motion.xyz - log.xyz)[:, 0]
    moved = np.asarray(state.controlled & log.valid)
    np.testing.assert_array_equal(shift != 0, moved)
    assert len(np.unique(shift[moved])) == moved.sum() > 5


@pytest.mark.parametrize(
    ("name", "value"),
    [("position_noise", -1.0), ("yaw_noise", math.inf), ("latest", -1)],
)
def test_what_is_no_deviation_is_refused(name: str, value: float) -> None:
    message = f"{name} must be at least 0 and finite, got {value}"
    with pytest.raises(ValueError, match=message):
        StartConfig(**{name: value})
