"""Tests that PPO learns what each probe needs, alone and together."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Agent, Output
from drivetrain.agents.distributions import Categorical
from drivetrain.learners import mesh as meshes, optim, program
from drivetrain.learners.base import Metrics, TrainState
from drivetrain.learners.pasts import Pasts
from drivetrain.learners.ppo import PPOConfig, ppo
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.data.stratum import Stratum
from drivetrain.sim.env.base import Environment
from drivetrain.sim.env.demonstrations import Demonstration
from tests.learners import crowd, probes, recurrent
from tests.learners.probes import Probe

GAMMA = 0.9
CONFIG = PPOConfig(
    learning_rate=3e-2,
    num_worlds=32,
    steps_per_update=12,
    strata=8,
    discount=GAMMA,
    minibatches=2,
)
ROUNDING = 1e-5  # float32 sums of hundreds of numbers of order one
LEARNED = 0.05  # of values and probabilities of order one: far from what they began as


def output(values: jax.Array) -> Output:
    return Output(policy=Categorical(logits=values[:2]), value=values[2])


LINEAR, GRU = probes.linear_agent(output, 3), recurrent.gru_agent()


def no_sample(bank: Bank, stratum: Stratum, key: jax.Array) -> Demonstration:
    raise AssertionError("nobody is imitated")


def train(
    agent: Agent,
    env: Environment,
    config: PPOConfig = CONFIG,
    num_updates: int = 60,
    sample: Callable = no_sample,
) -> tuple[TrainState, Metrics]:
    """Returns the last train state, and the metrics of each update."""
    learner = ppo(agent, lambda past: env, sample, optim.adam(config), config)
    mesh = meshes.data_mesh()
    run = program.compile_program(learner, mesh, num_updates)
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    return run(program.initial_state(learner, mesh, jax.random.key(0), bank), bank)


def value(agent: Agent, state: TrainState, probe: Probe, step: int, sign: float):
    """Returns what a state is worth to an agent that remembers nothing."""
    seen = probes.observe(probe, step, sign)
    _, output = agent.step(state.params, agent.memory(), seen)
    return float(state.kept.normalizer.restore(output.value))


def last(metrics: Metrics, name: str) -> float:
    """Returns the mean of a metric over the last ten updates."""
    return float(metrics[name].total[-10:].sum() / metrics[name].weight[-10:].sum())


TRUNCATED = {(0, 1.0): 1 / (1 - GAMMA)}


@pytest.mark.parametrize(
    ("advantage", "probe", "values"),
    [
        ("gae", probes.VALUE, {(0, 1.0): 1.0}),
        ("gae", probes.DISCOUNTING, {(0, 1.0): GAMMA, (1, 1.0): 1.0}),
        ("gae", probes.BOOTSTRAPPING, {(0, 1.0): GAMMA, (0, -1.0): -GAMMA}),
        ("gae", probes.TRUNCATION, TRUNCATED),
        ("vtrace", probes.TRUNCATION, TRUNCATED),
    ],
    ids=["value", "discounting", "bootstrapping", "truncation", "vtrace"],
)
def test_values_are_learned(advantage: str, probe: Probe, values: dict) -> None:
    config = dataclasses.replace(CONFIG, advantage=advantage)
    state, _ = train(LINEAR, probes.environment(probe), config)
    for (step, sign), expected in values.items():
        found = value(LINEAR, state, probe, step, sign)
        assert abs(found - expected) < LEARNED * max(1, abs(expected))


def test_values_stay_right_when_the_rate_decays() -> None:
    # Returns go on growing meanwhile, and what normalized values mean with them.
    config = dataclasses.replace(CONFIG, decay_updates=320)
    env, probe = probes.environment(probes.TRUNCATION), probes.TRUNCATION
    state, _ = train(LINEAR, env, config, num_updates=100)
    found, expected = value(LINEAR, state, probe, 0, 1.0), 1 / (1 - GAMMA)
    assert abs(found - expected) < LEARNED * expected


@pytest.mark.parametrize(
    ("advantage", "probe"),
    [
        ("gae", probes.POLICY),
        ("gae", probes.MATCHING),
        ("vtrace", probes.MATCHING),
    ],
    ids=["policy", "matching", "vtrace"],
)
def test_policies_are_learned(advantage: str, probe: Probe) -> None:
    config = dataclasses.replace(CONFIG, advantage=advantage)
    _, metrics = train(LINEAR, probes.environment(probe), config)
    assert last(metrics, "episode/return") > 1 - LEARNED
    assert last(metrics, "episode/collision") < LEARNED
    assert last(metrics, "entropy") < 0.3


def test_what_was_seen_first_is_remembered_to_the_last() -> None:
    env = probes.environment(probes.MEMORY)
    _, metrics = train(GRU, env, num_updates=150)
    assert last(metrics, "episode/return") > 1 - LEARNED
    _, metrics = train(LINEAR, env)
    assert last(metrics, "episode/return") < 0.7  # half of it is luck


@pytest.mark.parametrize(
    ("agent", "max_actors"),
    [(LINEAR, None), (GRU, None), (LINEAR, 4), (GRU, 4)],
    ids=["linear", "gru", "linear-seats", "gru-seats"],
)
def test_several_actors_learn_together(agent: Agent, max_actors: int | None) -> None:
    _, metrics = train(agent, crowd.environment(max_actors=max_actors))
    assert last(metrics, "episode/collision") < 2 * LEARNED
    # Of each: 1, 2, 3 and 3 steps, of which one more is shown.
    assert abs(last(metrics, "episode/length") - 9 / 4) < ROUNDING
    assert last(metrics, "env_steps") == 32 * 9
    assert last(metrics, "agent_steps") == 32 * 9 * 3


@pytest.mark.parametrize(
    ("agent", "advantage"), [(LINEAR, "gae"), (GRU, "vtrace")], ids=["gae", "vtrace"]
)
def test_who_is_absent_or_done_changes_nothing(agent: Agent, advantage: str) -> None:
    config = dataclasses.replace(CONFIG, advantage=advantage, kl_limit=0.1)
    clean, told = train(agent, crowd.environment(), config, 4)
    spoilt, told_too = train(agent, crowd.environment(garbage=50.0), config, 4)
    jax.tree.map(np.testing.assert_array_equal, clean.params, spoilt.params)
    for one, other in ((clean.kept, spoilt.kept), (told, told_too)):
        jax.tree.map(np.testing.assert_array_equal, one, other)


def test_an_update_ends_where_the_policy_has_gone_too_far() -> None:
    env = probes.environment(probes.MATCHING)
    near = dataclasses.replace(CONFIG, kl_limit=1e-9)
    state, metrics = train(LINEAR, env, near, 3)
    # The first of 8 minibatches finds the policy unmoved, the second does not.
    np.testing.assert_array_equal(metrics["skipped"].total, [7, 7, 7])
    np.testing.assert_array_equal(metrics["skipped"].weight, [8, 8, 8])
    assert state.kept.gradient_steps == 3 and state.step == 3
    # What is not looked at is not told of: the first two halves of 9 steps a world.
    np.testing.assert_array_equal(metrics["kl"].weight, 32 * 6)

    far = dataclasses.replace(CONFIG, kl_limit=1e9)
    state, metrics = train(LINEAR, env, far, 3)
    assert state.kept.gradient_steps == 3 * 8 and not metrics["skipped"].total.any()


def test_the_expert_is_imitated_where_rewards_tell_nothing() -> None:
    probe = dataclasses.replace(probes.MATCHING, reward=lambda *_: jnp.float32(0.0))
    env = probes.environment(probe)

    def sample(bank: Bank, stratum: Stratum, key: jax.Array) -> Demonstration:
        sign = jax.random.rademacher(key, (), jnp.float32)
        seen = env.observe(bank, probes.state(0, 1.0).replace(sim_agent=sign))
        action = (sign > 0).astype(jnp.int32)
        return Demonstration(observation=seen, action=action, weight=jnp.ones(()))

    config = dataclasses.replace(
        CONFIG,
        learning_rate=0.1,
        epochs=1,
        minibatches=1,
        imitation_weight=0.5,
        imitation_batch_size=32,
    )
    _, metrics = train(LINEAR, env, config, sample=sample)
    assert last(metrics, "imitation/accuracy") == 1
    assert last(metrics, "imitation/loss") < 2 * LEARNED
    weights = {
        "policy_loss": 1.0,
        "value_loss": 0.5,
        "entropy": -0.001,
        "imitation/loss": 0.5,
    }
    means = {name: mean.total / mean.weight for name, mean in metrics.items()}
    whole = sum(weight * means[name] for name, weight in weights.items())
    np.testing.assert_allclose(means["loss"], whole, atol=ROUNDING)


def test_the_critic_explains_returns_once_it_is_right() -> None:
    _, metrics = train(LINEAR, probes.environment(probes.BOOTSTRAPPING))
    explained = metrics["explained_variance"]
    assert abs(explained.total[0] / explained.weight[0]) < 0.3
    assert last(metrics, "explained_variance") > 1 - LEARNED


def test_past_selves_are_handed_to_the_task() -> None:
    # The task pays the sum of all parameters of the newest of two past selves.
    def env_of(pasts: Pasts | tuple[()]) -> Environment:
        assert isinstance(pasts, Pasts)
        newest = (pasts.count - 1) % 2
        told = jnp.sum(pasts.params["table"][newest])
        return probes.environment(
            dataclasses.replace(probes.VALUE, reward=lambda *_: told)
        )

    config = dataclasses.replace(CONFIG, num_pasts=2, past_every=3)
    learner = ppo(LINEAR, env_of, no_sample, optim.adam(config), config)
    mesh = meshes.data_mesh()
    run = program.compile_program(learner, mesh, 1)
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    before, found = [], []
    for _ in range(9):
        before.append(float(jnp.sum(state.params["table"])))
        state, metrics = run(state, bank)
        told = metrics["episode/return"]
        found.append(float(told.total[0] / told.weight[0]))
    assert len(set(before)) == 9
    expected = np.repeat([before[0], before[3], before[6]], 3)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"num_worlds": 12}, "num_worlds must be a positive multiple of strata"),
        ({"steps_per_update": 0}, "steps_per_update must be at least 1"),
        ({"num_pasts": -1}, "num_pasts must be at least 0"),
        ({"discount": 1.1}, "discount must be from 0 to 1"),
        ({"learning_rate": 0.0}, "must be positive"),
        ({"epochs": 0}, "epochs must be at least 1"),
        (
            {"imitation_weight": 1.0, "imitation_batch_size": 9},
            "imitation_batch_size must be a positive multiple",
        ),
    ],
)
def test_values_out_of_range_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(CONFIG, **fields)


def test_minibatches_that_do_not_divide_strata_are_refused() -> None:
    config = dataclasses.replace(CONFIG, minibatches=3)
    with pytest.raises(ValueError, match="minibatches must divide the 4 worlds"):
        ppo(
            GRU, lambda past: crowd.environment(), no_sample, optim.adam(config), config
        )
