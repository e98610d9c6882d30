"""Run by `mesh_test.py` in a process that sees four devices; prints what it finds."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import optax

from drivetrain.learners import mesh as meshes, optim, program
from drivetrain.learners.base import Learner
from drivetrain.learners.bc import CloningConfig, behavior_cloning
from drivetrain.sim.data.stratum import Stratum
from drivetrain.sim.env.demonstrations import Demonstration, Sample
from tests.learners import toy

NUM_ACTIONS = 1000
MESH = meshes.data_mesh()


def blind(sample: Sample, batch_size: int) -> Learner:
    """Clones with parameters that are the logits, by plain gradient descent."""
    agent = toy.softmax(lambda key: jnp.zeros(NUM_ACTIONS), lambda params, _: params)
    descent = optim.Optimizer(
        transformation=optax.sgd(1.0), learning_rate=optax.constant_schedule(1.0)
    )
    config = CloningConfig(batch_size=batch_size, strata=MESH.size)
    return behavior_cloning(agent, sample, descent, config)


def demonstrate(bank: Demonstration, stratum: Stratum, key: jax.Array) -> Demonstration:
    """Returns the one demonstration that a device has."""
    return bank


def demonstrate_anything(
    bank: Demonstration, stratum: Stratum, key: jax.Array
) -> Demonstration:
    """Acts at random."""
    return bank.replace(action=jax.random.randint(key, (), 0, NUM_ACTIONS))


def main() -> None:
    """Prints parameters and metrics after one update of each learner."""
    bank = Demonstration(
        observation={},
        action=jnp.arange(MESH.size, dtype=jnp.int32),
        weight=jnp.array([0.0, 1.0, 2.0, 5.0]),
    )
    results = {"num_devices": MESH.size}
    for name, sample in (("own", demonstrate), ("any", demonstrate_anything)):
        learner = blind(sample, batch_size=MESH.size)
        run = program.compile_program(learner, MESH, updates_per_call=1)
        shared = meshes.shard(MESH, bank)
        state = program.initial_state(learner, MESH, jax.random.key(0), shared)
        state, metrics = run(state, shared)
        loss = metrics["loss"].total[0] / metrics["loss"].weight[0]
        replicas = [
            np.asarray(s.data).tolist() for s in state.params.addressable_shards
        ]
        results[name] = {"params": replicas, "loss": float(loss)}
    print(json.dumps(results))


main()
