"""Run by `devices_test.py` in a process of eight devices; prints what it finds."""

import json
from collections.abc import Callable

import jax
import numpy as np
from jax.sharding import Mesh

from drivetrain.agents import build as agents
from drivetrain.agents.encoders.flat import FlatConfig
from drivetrain.learners import mesh as meshes, optim, program
from drivetrain.learners.base import Bank, Learner
from drivetrain.learners.bc import CloningConfig, behavior_cloning
from drivetrain.sim.data import bank as banks, dealing
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env.demonstrations import demonstrations
from drivetrain.sim.observations.vector import vector
from tests import worlds
from tests.learners.every import LEARNERS
from tests.sim.env.planning_test import SMALL, env_of

UPDATES = 10
STRATA = 8


def cloning(mesh: Mesh) -> tuple[Learner, Bank]:
    """Clones the experts of real banks."""
    packed = [worlds.exact(scenario) for scenario in worlds.scenarios("generated")]
    sizes = banks.Sizes.of(packed, worlds.MAX_OBJECTS)
    dealt = dealing.by_stratum(len(packed), mesh.size, STRATA)
    bank = meshes.shard(mesh, dealing.build_shards(packed, sizes, dealt))
    env = env_of("bicycle_discrete")
    local = jax.tree.map(lambda leaf: leaf[0], bank)
    state = jax.eval_shape(env.reset, local, np.int32(0), jax.random.key(0))
    seen = jax.eval_shape(env.observe, local, state)
    network = agents.AgentConfig(
        encoder=FlatConfig(widths=(16,), scale=1.0), num_hidden_layers=0
    )
    agent = agents.build(network, seen, env.action_spec)
    sample = demonstrations(dynamics.build("bicycle_discrete"), vector(SMALL))
    config = CloningConfig(batch_size=16, strata=STRATA, learning_rate=1e-3)
    return behavior_cloning(agent, sample, optim.adam(config), config), bank


def small(name: str) -> Callable[[Mesh], tuple[Learner, Bank]]:
    """Returns what builds one of the small learners."""
    build, bank_of = LEARNERS[name]
    return lambda mesh: (build(), meshes.shard(mesh, bank_of(mesh.size)))


def after(build: Callable[[Mesh], tuple[Learner, Bank]], num_devices: int) -> dict:
    """Returns the parameters and metrics after some updates."""
    mesh = jax.make_mesh(
        (num_devices,),
        (meshes.AXIS,),
        axis_types=meshes.data_mesh().axis_types,
        devices=jax.devices()[:num_devices],
    )
    learner, bank = build(mesh)
    run = program.compile_program(learner, mesh, UPDATES)
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, metrics = run(state, bank)
    leaves = [np.asarray(leaf).ravel() for leaf in jax.tree.leaves(state.params)]
    return {
        "params": np.concatenate(leaves).tolist(),
        "metrics": {
            name: (mean.total / np.maximum(mean.weight, 1.0)).tolist()
            for name, mean in metrics.items()
        },
    }


def main() -> None:
    """Prints what each learner has become on one device, and on several."""
    found = {"bc of logs": [after(cloning, count) for count in (1, 8)]}
    for name in LEARNERS:
        found[name] = [after(small(name), count) for count in (1, 8)]
    print(json.dumps(found))


main()
