"""Tests that seeds in one program learn as each does alone, and always the same."""

import functools
from collections.abc import Callable

import jax
import numpy as np
import pytest

from drivetrain.agents.base import Params
from drivetrain.learners import mesh as meshes, program, seeds
from drivetrain.learners.base import Bank, Learner, Program, TrainState
from tests.learners.checkpoint_test import assert_same
from tests.learners.every import LEARNERS

# Sums of float32 in another order, over ten updates with steps of at most 0.03.
ROUNDING = 1e-4
UPDATES = 10


def trained(
    learner: Learner,
    bank_of: Callable[[int], Bank],
    key: jax.Array,
    over_seeds: Callable[[Program], Program] = lambda run: run,
) -> TrainState:
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, bank_of(mesh.size))
    state = program.initial_state(learner, mesh, key, bank)
    return program.compile_program(learner, mesh, UPDATES, over_seeds)(state, bank)[0]


def assert_differs(one: Params, other: Params) -> None:
    same = jax.tree.map(lambda a, b: bool((a == b).all()), one, other)
    assert not all(jax.tree.leaves(same))


@functools.cache
def alone(name: str, seed: int) -> TrainState:
    build, bank_of = LEARNERS[name]
    return trained(build(), bank_of, jax.random.key(seed))


@pytest.mark.parametrize("name", LEARNERS)
@pytest.mark.parametrize(
    ("over_seeds", "rounding"), [(seeds.side_by_side, ROUNDING), (seeds.in_turn, 0.0)]
)
def test_each_seed_ends_as_it_does_alone(
    name: str, over_seeds: Callable[[Program], Program], rounding: float
) -> None:
    build, bank_of = LEARNERS[name]
    keys = jax.vmap(jax.random.key)(np.arange(2))
    together = trained(build(), bank_of, keys, over_seeds)
    for number in range(2):
        expected, own = alone(name, number), seeds.one_of(together, number)
        jax.tree.map(
            functools.partial(np.testing.assert_allclose, atol=rounding, rtol=0),
            own.params,
            expected.params,
        )
        assert own.step == UPDATES
        assert_differs(own.params, alone(name, 1 - number).params)
        assert (own.key == expected.key).all()


@pytest.mark.parametrize("name", LEARNERS)
def test_the_same_seed_ends_the_same_to_the_last_bit(name: str) -> None:
    build, bank_of = LEARNERS[name]
    assert_same(alone(name, 0), trained(build(), bank_of, jax.random.key(0)))
