"""Tests that behavior cloning learns, weighs, and shares its batch among devices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Agent
from drivetrain.learners import balance, bc, mesh as meshes, optim, program
from drivetrain.learners.base import Learner
from drivetrain.sim.data.stratum import Stratum
from drivetrain.sim.dynamics.base import Continuous
from drivetrain.sim.observations.base import Observation, TokenGroup
from tests.learners import recurrent, toy

FAST = optim.OptimizerConfig(learning_rate=3e-3, warmup_updates=20)


def train(learner: Learner, num_calls: int) -> dict[str, float]:
    mesh = meshes.data_mesh()
    run = program.compile_program(learner, mesh, updates_per_call=100)
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    train_state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    for _ in range(num_calls):
        train_state, metrics = run(train_state, bank)
    return {name: float(m.total.sum() / m.weight.sum()) for name, m in metrics.items()}


def cloning(sample: bc.Sample, agent: Agent) -> Learner:
    config = bc.CloningConfig(batch_size=64)
    return bc.behavior_cloning(agent, sample, optim.adam(FAST), config)


def test_an_agent_that_remembers_is_refused() -> None:
    with pytest.raises(ValueError, match="memory_width=0"):
        cloning(toy.sampler(toy.sign), recurrent.gru_agent())


def test_it_learns_a_sign_among_masked_distractors() -> None:
    metrics = train(cloning(toy.sampler(toy.sign), toy.agent()), num_calls=3)
    assert metrics["accuracy"] > 0.95


def test_it_learns_when_a_token_was_seen() -> None:
    def appear(values: jax.Array) -> jax.Array:
        return (jnp.abs(values[0, 0, 0]) * 100).astype(jnp.int32) % toy.NUM_STEPS

    def see(values: jax.Array) -> Observation:
        mask = jnp.zeros(values.shape[:2], bool).at[0, appear(values)].set(True)
        return {"objects": TokenGroup(values=jnp.ones_like(values), mask=mask)}

    sample = toy.sampler(lambda values: appear(values) // 2, see)
    metrics = train(cloning(sample, toy.agent()), num_calls=3)
    assert metrics["accuracy"] > 0.95


def test_it_learns_two_modes_of_a_continuous_action() -> None:
    bounds = Continuous(low=(-6.0,), high=(6.0,))
    sample = toy.sampler(lambda values: 4.0 * jnp.sign(values[0, -1, :1]))
    metrics = train(cloning(sample, toy.agent(bounds)), num_calls=5)
    assert metrics["absolute_error"] < 0.05


def test_demonstrations_of_no_weight_change_nothing() -> None:
    def sample(
        bank: dict[str, jax.Array], stratum: Stratum, key: jax.Array
    ) -> bc.Demonstration:
        drawn = toy.sampler(toy.sign)(bank, stratum, key)
        return drawn.replace(weight=jnp.zeros(()))

    learner = cloning(sample, toy.linear_agent())
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    before = program.initial_state(learner, mesh, jax.random.key(0), bank)
    kept = jax.tree.map(np.asarray, before.params)
    run = program.compile_program(learner, mesh, updates_per_call=3)
    after, metrics = run(before, bank)
    jax.tree.map(np.testing.assert_array_equal, after.params, kept)
    assert (metrics["loss"].weight == 0).all()


def test_each_update_draws_anew() -> None:
    drawn = bc.Demonstration(
        observation={}, action=jnp.zeros((), jnp.int32), weight=jnp.zeros(())
    )

    def sample(
        bank: dict[str, jax.Array], stratum: Stratum, key: jax.Array
    ) -> bc.Demonstration:
        return drawn.replace(weight=jax.random.uniform(key))

    indifferent = toy.softmax(lambda key: jnp.zeros(2), lambda params, _: params)
    learner = cloning(sample, indifferent)
    mesh = meshes.data_mesh()
    run = program.compile_program(learner, mesh, updates_per_call=1)
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, first = run(state, bank)
    _, second = run(state, bank)
    assert first["loss"].weight[0] != second["loss"].weight[0]


def test_balanced_actions_weigh_the_same_however_rare() -> None:
    shown = jnp.array([0] * 6 + [1] * 2)
    seen = balance.Frequencies(weight=jnp.array([60.0, 20.0]))
    weights = balance.weights(seen, shown, 1.0)
    assert weights[:6].sum() == weights[6:].sum()
    np.testing.assert_array_equal(balance.weights(seen, shown, 0.0), np.ones(8))


def test_balance_counts_what_was_shown_in_all_updates() -> None:
    config = bc.CloningConfig(batch_size=64, class_balance=1.0)
    sample = toy.sampler(lambda values: jnp.int32(1))
    learner = bc.behavior_cloning(
        toy.linear_agent(), sample, optim.adam(config), config
    )
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, _ = program.compile_program(learner, mesh, 3)(state, bank)
    np.testing.assert_array_equal(state.kept.weight, [1, 1 + 3 * 64])


def test_continuous_actions_are_not_balanced() -> None:
    config = bc.CloningConfig(class_balance=0.5)
    bounds = Continuous(low=(-6.0,), high=(6.0,))
    sample = toy.sampler(lambda values: values[0, -1, :1])
    learner = bc.behavior_cloning(toy.agent(bounds), sample, optim.adam(config), config)
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    with pytest.raises(ValueError, match="class_balance needs numbered actions"):
        program.initial_state(learner, mesh, jax.random.key(0), bank)


@pytest.mark.parametrize("name", ["label_smoothing", "class_balance"])
def test_shares_out_of_range_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} must be from 0 to 1, got 1.5"):
        bc.CloningConfig(**{name: 1.5})
