"""Tests that a learner becomes one program: traced once, fed by no host."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import mesh as meshes, program
from drivetrain.learners.base import Bank, Learner, Metrics, TrainState, one
from tests.learners import every, toy
from tests.learners.every import LEARNERS


def counting_learner(traces: list[None]) -> Learner:
    """Adds the bank's first value to its parameter at each update."""

    def init(key: jax.Array, bank: Bank, axis_name: str) -> TrainState:
        step = jnp.zeros((), jnp.int32)
        return TrainState(params=jnp.zeros(()), opt_state=(), step=step, key=key)

    def act(
        train_state: TrainState, bank: Bank, axis_name: str
    ) -> tuple[TrainState, tuple[()]]:
        return train_state, ()

    def learn(
        train_state: TrainState, experience: tuple[()], bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        traces.append(None)
        params = train_state.params + jax.lax.psum(bank["value"], axis_name)
        moved = train_state.replace(params=params, step=train_state.step + 1)
        return moved, {"step": one(train_state.step)}

    return Learner(init=init, act=act, learn=learn)


def test_a_call_makes_all_its_updates_and_shows_the_metrics_of_each() -> None:
    mesh = meshes.data_mesh()
    learner = counting_learner([])
    run = program.compile_program(learner, mesh, updates_per_call=5)
    bank = meshes.shard(mesh, {"value": np.full(mesh.size, 2.0, np.float32)})
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, metrics = run(state, bank)
    assert (state.step, state.params) == (5, 10 * mesh.size)
    np.testing.assert_array_equal(metrics["step"].total, np.arange(5))


def test_many_calls_are_traced_and_compiled_once() -> None:
    traces: list[None] = []
    mesh = meshes.data_mesh()
    learner = counting_learner(traces)
    run = program.compile_program(learner, mesh, updates_per_call=3)
    bank = meshes.shard(mesh, {"value": np.ones(mesh.size, np.float32)})
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, _ = run(state, bank)
    for _ in range(4):
        state, _ = run(state, bank)
    assert len(traces) == 1
    assert run._cache_size() == 1


def test_updates_need_nothing_from_the_host() -> None:
    mesh = meshes.data_mesh()
    learner = every.cloning()
    run = program.compile_program(learner, mesh, updates_per_call=2)
    on_host = toy.bank(mesh.size)
    bank = meshes.shard(mesh, on_host)
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, _ = run(state, bank)
    with jax.transfer_guard("disallow"):
        state, _ = run(state, bank)
        # The guard does see what comes from the host.
        with pytest.raises(jax.errors.JaxRuntimeError, match="Disallowed"):
            run(state, jax.tree.map(np.asarray, on_host))


@pytest.mark.parametrize("name", LEARNERS)
def test_no_learner_calls_the_host(name: str) -> None:
    mesh = meshes.data_mesh()
    build, bank_of = LEARNERS[name]
    learner, bank = build(), meshes.shard(mesh, bank_of(mesh.size))
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    run = program.compile_program(learner, mesh, updates_per_call=2)
    assert "callback" not in run.lower(state, bank).as_text()


def test_a_call_to_the_host_would_be_seen() -> None:
    def shout(x: jax.Array) -> jax.Array:
        jax.debug.print("{}", x)
        return x

    assert "callback" in jax.jit(shout).lower(1.0).as_text()


def test_the_state_given_is_donated() -> None:
    mesh = meshes.data_mesh()
    learner = every.cloning()
    run = program.compile_program(learner, mesh, updates_per_call=1)
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    run(state, bank)
    assert all(leaf.is_deleted() for leaf in jax.tree.leaves(state.params))


def test_a_bank_for_other_devices_is_refused() -> None:
    mesh = meshes.data_mesh()
    with pytest.raises(ValueError, match="leading axis"):
        meshes.shard(mesh, toy.bank(mesh.size + 1))
