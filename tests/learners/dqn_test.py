"""Tests that double Q-learning solves what it should, by the numbers it should."""

import dataclasses
import functools
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents import build as agents
from drivetrain.agents.base import Agent, Output
from drivetrain.agents.distributions import ActionValues
from drivetrain.learners import dqn, mesh as meshes, optim, program, q_learning
from drivetrain.learners.base import Learner, Metrics, TrainState
from drivetrain.learners.checkpoint import Checkpoints
from drivetrain.learners.dqn import DQNConfig
from drivetrain.learners.replay import prioritized
from drivetrain.learners.replay.prioritized import ReplayConfig
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.data.stratum import Stratum
from drivetrain.sim.dynamics.base import Continuous, Discrete
from drivetrain.sim.env.demonstrations import Demonstration, Sample
from tests.learners import probes, toy
from tests.learners.checkpoint_test import assert_same
from tests.learners.evaluator_test import sharded
from tests.learners.probes import Probe
from tests.sim.env.planning_test import env_of

GAMMA = 0.5  # of the probes: its powers differ a lot, and errors die out fast
# Of the values of a tabular agent after the updates of `train`: the target still
# follows, and Adam's steps of 0.03 still wander.
LEARNED = 0.05
ROUNDING = 1e-6  # relative, of float32


def agent() -> Agent:
    def output(values: jax.Array) -> Output:
        return Output(policy=ActionValues(values=values), value=jnp.zeros(()))

    return probes.linear_agent(output, probes.NUM_ACTIONS)


def config(**fields) -> DQNConfig:
    small = {
        "learning_rate": 0.03,
        "strata": 4,
        "num_worlds": 16,
        "steps_per_update": 4,
        "batch_size": 32,
        "samples_per_insertion": 4.0,
        "min_replay": 64,
        "replay": ReplayConfig(capacity=512),
        "discount": GAMMA,
        "target_period": 5,
        "exploration_steps": 2000,
        "final_epsilon": 0.2,
        "total_steps": 10_000,
    }
    return DQNConfig(**small | fields)


def never(bank: Bank, stratum: Stratum, key: jax.Array) -> Demonstration:
    raise AssertionError("no demonstration is needed")


def learner(probe: Probe, settings: DQNConfig, sample: Sample = never) -> Learner:
    env = probes.environment(probe)
    return dqn.double_dqn(agent(), env, sample, optim.adam(settings), settings)


def train(made: Learner, num_updates: int, seed: int = 0) -> tuple[TrainState, Metrics]:
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    run = program.compile_program(made, mesh, num_updates)
    return run(program.initial_state(made, mesh, jax.random.key(seed), bank), bank)


def values(probe: Probe, state: TrainState, step: int, sign: float) -> np.ndarray:
    seen = probes.observe(probe, step, sign)
    return np.asarray(q_learning.action_values(agent(), state.params, seen))


def test_its_target_begins_with_the_parameters_that_it_is_given() -> None:
    made, mesh = learner(probes.VALUE, config()), meshes.data_mesh()
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    one, other = (
        program.initial_state(made, mesh, jax.random.key(seed), bank)
        for seed in range(2)
    )
    begun = made.adopt(one, other.params)
    for params in (begun.params, begun.kept.target):
        jax.tree.map(np.testing.assert_array_equal, params, other.params)
    # The program may write over what it is given, of which nothing is there twice.
    program.compile_program(made, mesh, 1)(begun, bank)


def test_it_learns_a_value() -> None:
    state, _ = train(learner(probes.VALUE, config()), 60)
    np.testing.assert_allclose(values(probes.VALUE, state, 0, 1), 1.0, atol=LEARNED)


@pytest.mark.parametrize("n_step", [1, 6])
def test_it_discounts_a_late_reward(n_step: int) -> None:
    state, _ = train(learner(probes.DISCOUNTING, config(n_step=n_step)), 100)
    found = [values(probes.DISCOUNTING, state, step, 1) for step in (0, 1)]
    expected = np.array([[GAMMA, GAMMA], [1.0, 1.0]])
    np.testing.assert_allclose(found, expected, atol=LEARNED)


def test_it_passes_a_value_back_by_what_is_seen() -> None:
    probe = probes.BOOTSTRAPPING
    state, _ = train(learner(probe, config()), 150)
    for sign in (-1.0, 1.0):
        found = [values(probe, state, step, sign) for step in (0, 1)]
        expected = sign * np.array([[GAMMA, GAMMA], [1.0, 1.0]])
        np.testing.assert_allclose(found, expected, atol=LEARNED)


def test_it_values_what_a_cut_takes_away() -> None:
    state, _ = train(learner(probes.TRUNCATION, config()), 150)
    found = values(probes.TRUNCATION, state, 0, 1)
    np.testing.assert_allclose(found, 1 / (1 - GAMMA), atol=LEARNED)


def test_it_tells_actions_apart() -> None:
    state, metrics = train(learner(probes.POLICY, config()), 80)
    found = values(probes.POLICY, state, 0, 1)
    np.testing.assert_allclose(found, [0.0, 1.0], atol=LEARNED)
    # A random action is the worse one half of the time, and counts as a collision.
    rate = metrics["episode/collision"]
    rate = float(rate.total[-20:].sum() / rate.weight[-20:].sum())
    assert abs(rate - config().final_epsilon / 2) < 0.05


def test_it_acts_on_what_it_sees() -> None:
    state, _ = train(learner(probes.MATCHING, config()), 80)
    found = [values(probes.MATCHING, state, 0, sign) for sign in (-1.0, 1.0)]
    expected = np.array([[1.0, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(found, expected, atol=LEARNED)


def expert(bank: Bank, stratum: Stratum, key: jax.Array) -> Demonstration:
    """Takes action 1, in a world where all actions are as good."""
    return Demonstration(
        observation=probes.observe(probes.VALUE, 0, 1.0),
        action=jnp.int32(1),
        weight=jax.random.uniform(key),
    )


def test_imitation_makes_the_expert_better_by_the_margin() -> None:
    settings = config(imitation_weight=1.0, margin=0.6)
    state, metrics = train(learner(probes.VALUE, settings, expert), 80)
    gap = np.diff(values(probes.VALUE, state, 0, 1.0))
    np.testing.assert_allclose(gap, 0.6, atol=LEARNED)
    assert metrics["margin"].weight[-1] > 0


@pytest.mark.parametrize("ratio", [4.0, 1.5])
def test_samples_to_insertions_are_as_asked(ratio: float) -> None:
    # Of three steps one shows the end of an episode, and is no insertion.
    settings = config(samples_per_insertion=ratio, min_replay=100)
    state, metrics = train(learner(probes.DISCOUNTING, settings), 50)
    gradient_steps, env_steps, size = (
        np.asarray(metrics[name].total, int)
        for name in ("gradient_steps", "env_steps", "replay_size")
    )
    played = 50 * settings.num_worlds * settings.steps_per_update
    total = np.cumsum(env_steps)
    assert abs(total[-1] / played - 2 / 3) < 0.02

    first = int(np.argmax(size >= settings.min_replay))
    assert first > 0 and (gradient_steps[:first] == 0).all()
    inserted = total[first:] - total[first - 1]
    drawn = np.cumsum(gradient_steps[first:]) * settings.batch_size
    owed = ratio * inserted - drawn
    assert (owed >= 0).all() and (owed < settings.batch_size).all()
    assert int(state.kept.owed) == owed[-1] * settings.ratio.denominator
    assert int(state.kept.num_gradient_steps) == gradient_steps.sum()
    assert (int(state.step), int(state.kept.num_env_steps)) == (50, total[-1])


@pytest.mark.parametrize(("n_step", "steps_per_update"), [(1, 4), (2, 1), (6, 4)])
def test_transitions_are_whole_wherever_updates_end(
    n_step: int, steps_per_update: int
) -> None:
    # Nothing is learned: all are as likely to be drawn.
    settings = config(n_step=n_step, steps_per_update=steps_per_update, min_replay=512)
    state, _ = train(learner(probes.DISCOUNTING, settings), 32 // steps_per_update)
    replay = state.worlds.replay
    drawn = jax.vmap(prioritized.sample, in_axes=(0, 0, None, None))(
        replay, jax.random.split(jax.random.key(3), settings.strata), 2000, 1.0
    )
    step_t, step_tpn = (
        np.asarray(seen["coin"].values).reshape(-1, probes.NUM_FEATURES).argmax(axis=1)
        for seen in (drawn.items.observation_t, drawn.items.observation_tpn)
    )
    # The step that shows the end of an episode, the third, begins none.
    np.testing.assert_array_equal(np.unique(step_t), [0, 1])
    reaches_end = (step_t == 1) | (n_step > 1)
    np.testing.assert_array_equal(step_tpn, np.where(reaches_end, 2, 1))
    items = drawn.items
    np.testing.assert_array_equal(items.discount_tpn.ravel(), GAMMA * ~reaches_end)
    paid = np.where(reaches_end, GAMMA ** (1 - step_t), 0.0)
    np.testing.assert_array_equal(items.return_t.ravel(), paid)
    added = replay.num_added.sum()
    assert added == state.kept.num_env_steps
    # Of 32 steps in each of 16 worlds every third is none; the last n - 1 may wait.
    started = 16 * (32 - (n_step - 1)) * 2 / 3
    assert abs(added - started) <= 16


def test_random_actions_become_fewer_along_a_line() -> None:
    settings = config(min_replay=512, exploration_steps=400)
    _, metrics = train(learner(probes.VALUE, settings), 20)
    before = np.append(0, np.cumsum(metrics["env_steps"].total)[:-1])
    expected = np.interp(before, [0, 400], [1.0, 0.2])
    np.testing.assert_allclose(metrics["epsilon"].total, expected, rtol=ROUNDING)


def test_the_share_of_random_actions_is_epsilon() -> None:
    settings = config(
        initial_epsilon=0.5, final_epsilon=0.5, min_replay=512, num_worlds=32
    )
    state, _ = train(learner(probes.VALUE, settings), 6)
    best = values(probes.VALUE, state, 0, 0.0).argmax()
    replay = state.worlds.replay
    is_item = np.asarray(jax.vmap(lambda replay: replay.tree.priorities)(replay)) > 0
    share = (np.asarray(replay.items.action_t)[is_item] == best).mean()
    # Half of the random actions are the best one too; four deviations of a mean.
    assert abs(share - 0.75) < 4 * np.sqrt(0.75 * 0.25 / is_item.sum())


@pytest.mark.parametrize("period", [1, 10_000])
def test_the_target_follows_after_its_period(period: int) -> None:
    settings = config(target_period=period)
    state, metrics = train(learner(probes.VALUE, settings), 10)
    assert metrics["gradient_steps"].total.sum() > 10
    first, _ = train(learner(probes.VALUE, config(min_replay=512)), 1)
    expected = state.params if period == 1 else first.params
    np.testing.assert_array_equal(state.kept.target["table"], expected["table"])


def test_a_resumed_run_equals_one_that_was_not_cut(tmp_path: pathlib.Path) -> None:
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    made = learner(probes.BOOTSTRAPPING, config())
    run = program.compile_program(made, mesh, 10)
    state, _ = run(program.initial_state(made, mesh, jax.random.key(0), bank), bank)
    Checkpoints(tmp_path).save(10, state, {})
    uncut, _ = run(state, bank)
    fresh = program.initial_state(made, mesh, jax.random.key(1), bank)
    resumed, _ = run(Checkpoints(tmp_path).restore(fresh).tree, bank)
    assert_same(resumed, uncut)


def test_an_update_is_one_program_that_keeps_the_replay_in_place() -> None:
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    settings = config(replay=ReplayConfig(capacity=400_000))
    made = learner(probes.BOOTSTRAPPING, settings)
    state = program.initial_state(made, mesh, jax.random.key(0), bank)
    size = sum(leaf.nbytes for leaf in jax.tree.leaves(state.worlds.replay))
    compiled = program.compile_program(made, mesh, 2).lower(state, bank).compile()
    memory = compiled.memory_analysis()
    assert memory is not None
    assert memory.alias_size_in_bytes >= size
    assert memory.temp_size_in_bytes < size / 20
    assert "callback" not in compiled.as_text()


def test_other_agents_and_tasks_are_refused() -> None:
    env = probes.environment(probes.VALUE)
    optimizer = optim.adam(config())
    recurrent = dataclasses.replace(agent(), memory=lambda: jnp.zeros(3))
    with pytest.raises(ValueError, match="cannot remember"):
        dqn.double_dqn(recurrent, env, never, optimizer, config())
    for spec in (Continuous(low=(0.0,), high=(1.0,)), (Discrete(2),)):
        other = dataclasses.replace(env, action_spec=spec)
        with pytest.raises(ValueError, match="one actor with numbered actions"):
            dqn.double_dqn(agent(), other, never, optimizer, config())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"batch_size": 30}, "batch_size must be a positive multiple of strata"),
        ({"num_worlds": 6}, "num_worlds must be a positive multiple of strata"),
        ({"replay": ReplayConfig(capacity=510)}, "replay.capacity must be a positive"),
        ({"replay": ReplayConfig(capacity=60)}, "must hold the num_worlds"),
        ({"min_replay": 513}, "min_replay must be from 1 to replay.capacity"),
        ({"n_step": 0}, "n_step must be at least 1"),
        ({"discount": 1.5}, "discount must be from 0 to 1"),
        ({"samples_per_insertion": 0.3}, "make steps_per_update a multiple of 20"),
        ({"samples_per_insertion": 0.0}, "samples_per_insertion must be positive"),
        ({"huber": 0.0}, "huber must be positive or null"),
        ({"target_period": 0}, "target_period must be at least 1"),
        ({"final_epsilon": 1.1}, "from 0 to 1 in this order"),
        ({"imitation_weight": -1.0}, "at least 0 and finite"),
        ({"margin": float("inf")}, "margin must be at least 0 and finite"),
        ({"learning_rate": 0.0}, "must be positive"),
    ],
)
def test_values_out_of_range_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        config(**fields)


def test_it_fits_the_simulator() -> None:
    env, mesh, bank = env_of("bicycle_discrete"), meshes.data_mesh(), sharded()
    local = jax.tree.map(lambda leaf: leaf[0], bank)
    state = jax.eval_shape(env.reset, local, jnp.int32(0), jax.random.key(0))
    seen = jax.eval_shape(env.observe, local, state)
    driver = agents.build(toy.SMALL, seen, env.action_spec, "action_values")
    made = dqn.double_dqn(driver, env, never, optim.adam(config()), config())

    begin = functools.partial(program.initial_state, made, mesh)
    before = jax.eval_shape(begin, jax.random.key(0), bank)
    run = program.compile_program(made, mesh, 2)
    after, metrics = jax.eval_shape(run, before, bank)
    assert jax.tree.structure(after) == jax.tree.structure(before)
    assert {"episode/collision", "episode/offroad", "loss"} <= metrics.keys()
