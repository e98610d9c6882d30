"""Plays every scenario of a bank on the mesh and returns what is kept of each."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, PRNGKeyArray, PyTree

from ..sim.data.bank import Bank
from ..sim.env.base import Driver, Environment
from ..sim.env.rollout import Rollout, rollout
from ..sim.metrics import aggregate
from ..sim.metrics.aggregate import Episode
from . import actors, mesh as meshes

BATCH = 16  # worlds that play side by side on a device
CALL = 4 * BATCH  # worlds of a device in one call of the program

Evaluator = Callable[[PyTree, Bank, PRNGKeyArray, Callable[[int], None]], PyTree]


def figures(steps: Rollout) -> Episode:
    """Returns the figures of the ego's episode."""
    return aggregate.summarize(steps.measures)


def figures_of(env: Environment) -> Callable[[Rollout], Episode]:
    """Returns what makes figures of a task's episodes: the ego's, or each object's."""
    if not actors.is_multi_agent(env):
        return figures
    of_each = jax.vmap(aggregate.summarize, in_axes=1)
    return lambda steps: of_each(steps.measures)


def compile_evaluator(
    env: Environment,
    driver_of: Callable[[PyTree, Array], Driver],
    mesh: Mesh,
    keep: Callable[[Rollout], PyTree] = figures,
) -> Evaluator:
    """Compiles the evaluation of a driver.

    Args:
        env: what is played.
        driver_of: makes the driver from its parameters and the number of the scenario
            among all.
        mesh: the devices; each plays the scenarios of its own shard.
        keep: what to return of each episode.

    Returns:
        A function of the parameters (a copy on each device), the bank (sharded along a
        leading axis of devices), a key, and a function that is told how many scenarios
        are done. It returns what is kept of all episodes, as NumPy arrays in the order
        in which `dealing.once` dealt the scenarios.
    """

    def run(params: PyTree, bank: Bank, key: PRNGKeyArray, first: Array) -> PyTree:
        local_bank = jax.tree.map(lambda leaf: leaf[0], bank)

        def play(number):
            index = jnp.minimum(number, local_bank.num_scenarios - 1)
            # By the number among all scenarios: the same on any number of devices.
            overall = number * mesh.size + jax.lax.axis_index(meshes.AXIS)
            episode_key = jax.random.fold_in(key, overall)
            driver = driver_of(params, overall)
            return keep(rollout(env, driver, local_bank, index, episode_key))

        count = min(CALL, len(local_bank.num_steps))
        numbers = first + jnp.arange(count)
        episodes = jax.lax.map(play, numbers, batch_size=min(BATCH, count))
        return jax.tree.map(lambda leaf: leaf[:, None], episodes)

    everywhere, by_device = PartitionSpec(), PartitionSpec(meshes.AXIS)
    program = jax.jit(
        jax.shard_map(
            run,
            mesh=mesh,
            in_specs=(everywhere, by_device, everywhere, everywhere),
            out_specs=PartitionSpec(None, meshes.AXIS),
        ),
        out_shardings=NamedSharding(mesh, everywhere),  # so that each process has all
    )

    def evaluate(
        params: PyTree,
        bank: Bank,
        key: PRNGKeyArray,
        tick: Callable[[int], None] = lambda done: None,
    ) -> PyTree:
        total = int(jnp.sum(bank.num_scenarios))
        calls = []
        for first in range(0, bank.num_steps.shape[1], CALL):
            start = meshes.replicate(mesh, jnp.int32(first))
            calls.append(jax.device_get(program(params, bank, key, start)))
            tick(min((first + CALL) * mesh.size, total))

        # Number j of shard d is scenario j D + d (`dealing.once`).
        def in_order(*leaves: np.ndarray) -> np.ndarray:
            whole = np.concatenate(leaves)
            return whole.reshape(-1, *whole.shape[2:])[:total]

        return jax.tree.map(in_order, *calls)

    return evaluate
