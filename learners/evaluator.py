"""Plays every scenario of a bank on the mesh and returns the figures of each."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import PRNGKeyArray, PyTree

from ..sim.data.bank import Bank
from ..sim.env.base import Driver, Environment
from ..sim.env.rollout import rollout
from ..sim.metrics import aggregate
from ..sim.metrics.aggregate import Episode
from . import mesh as meshes

BATCH = 16  # worlds that play side by side on a device

Evaluator = Callable[[PyTree, Bank, PRNGKeyArray], Episode]


def compile_evaluator(
    env: Environment, driver_of: Callable[[PyTree], Driver], mesh: Mesh
) -> Evaluator:
    """Compiles the evaluation of a driver.

    Args:
        env: what is played.
        driver_of: makes the driver from its parameters.
        mesh: the devices; each plays the scenarios of its own shard.

    Returns:
        A function of the parameters (a copy on each device), the bank (sharded along a
        leading axis of devices) and a key. It returns the figures of all episodes, as
        NumPy arrays in the order in which `bank.build_shards` got the scenarios.
    """

    def run(params: PyTree, bank: Bank, key: PRNGKeyArray) -> Episode:
        local_bank = jax.tree.map(lambda leaf: leaf[0], bank)
        driver = driver_of(params)

        def play(number):
            index = jnp.minimum(number, local_bank.num_scenarios - 1)
            episode_key = jax.random.fold_in(key, number)
            steps = rollout(env, driver, local_bank, index, episode_key)
            return aggregate.summarize(steps.measures)

        numbers = jnp.arange(len(local_bank.num_steps))
        episodes = jax.lax.map(play, numbers, batch_size=min(BATCH, len(numbers)))
        return jax.tree.map(lambda leaf: leaf[:, None], episodes)

    everywhere, by_device = PartitionSpec(), PartitionSpec(meshes.AXIS)
    program = jax.jit(
        jax.shard_map(
            run,
            mesh=mesh,
            in_specs=(everywhere, by_device, everywhere),
            out_specs=PartitionSpec(None, meshes.AXIS),
        )
    )

    def evaluate(params: PyTree, bank: Bank, key: PRNGKeyArray) -> Episode:
        episodes = program(params, bank, key)
        total = int(np.sum(bank.num_scenarios))
        return jax.tree.map(lambda leaf: np.asarray(leaf).reshape(-1)[:total], episodes)

    return evaluate
