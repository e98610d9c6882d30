"""Tests that seeds side by side learn as each does alone."""

import jax
import numpy as np

from drivetrain.learners import bc, mesh as meshes, optim, program, seeds
from drivetrain.learners.base import Learner, TrainState
from tests.learners import toy

ROUNDING = 1e-5  # float32 sums in another order, over 20 updates of Adam
UPDATES = 20


def cloning() -> Learner:
    config = bc.CloningConfig(batch_size=16, learning_rate=1e-2)
    sample = toy.sampler(toy.sign)
    return bc.behavior_cloning(toy.linear_agent(), sample, optim.adam(config), config)


def trained(learner: Learner, key: jax.Array) -> TrainState:
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    state = program.initial_state(learner, mesh, key, bank)
    return program.compile_program(learner, mesh, UPDATES)(state, bank)[0]


def test_each_seed_ends_as_it_does_alone() -> None:
    keys = jax.vmap(jax.random.key)(np.arange(3))
    together = trained(seeds.side_by_side(cloning()), keys)
    for number in range(3):
        alone = trained(cloning(), jax.random.key(number))
        own = seeds.one_of(together, number)
        np.testing.assert_allclose(own.params, alone.params, atol=ROUNDING)
        assert own.step == UPDATES
        assert (own.key == alone.key).all()
