"""Tests of the evaluation and of training as fused programs over real banks."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.agents import build as agents
from drivetrain.learners import acting, build as learners, mesh as meshes
from drivetrain.learners.bc import CloningConfig
from drivetrain.learners.evaluator import compile_evaluator
from drivetrain.learners.program import compile_program, initial_state
from drivetrain.sim.data import dealing
from drivetrain.sim.data.bank import Sizes
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import drivers
from drivetrain.sim.env.demonstrations import demonstrations
from drivetrain.sim.env.rollout import rollout
from drivetrain.sim.metrics import aggregate
from drivetrain.sim.observations.vector import vector
from tests import worlds
from tests.learners import toy
from tests.sim.env.planning_test import SMALL, env_of

# The same rollout in two programs: 80 steps of float32 rounding at 100 m.
ROUNDING = 1e-3


@functools.cache
def sharded():
    """Returns the generated bank with a leading axis of one device."""
    packed = [worlds.exact(scenario) for scenario in worlds.scenarios("generated")]
    sizes = Sizes.of(packed, worlds.MAX_OBJECTS)
    return meshes.shard(
        meshes.data_mesh(), dealing.build_shards(packed, sizes, [range(len(packed))])
    )


def test_an_evaluation_plays_every_scenario_in_order() -> None:
    env, mesh = env_of("bicycle"), meshes.data_mesh()
    driver = drivers.build("coast", dynamics.build("bicycle"))
    evaluate = compile_evaluator(env, lambda params, number: driver, mesh)
    episodes = evaluate((), sharded(), meshes.replicate(mesh, jax.random.key(0)))

    @jax.jit
    def one(bank, index):
        steps = rollout(env, driver, bank, index, jax.random.key(1))
        return aggregate.summarize(steps.measures)

    for index in range(len(worlds.scenarios("generated"))):
        alone = one(worlds.bank("generated"), jnp.int32(index))
        for name, value in alone.value.items():
            np.testing.assert_allclose(
                episodes.value[name][index], value, rtol=ROUNDING, atol=ROUNDING
            )


def test_training_is_one_program_without_the_host() -> None:
    env, mesh, bank = env_of("bicycle_discrete"), meshes.data_mesh(), sharded()
    local = jax.tree.map(lambda leaf: leaf[0], bank)
    observation = jax.eval_shape(
        lambda bank: env.observe(
            bank, env.reset(bank, jnp.int32(0), jax.random.key(0))
        ),
        local,
    )
    agent = agents.build(toy.SMALL, observation, env.action_spec)
    num_traces = 0

    def sample(bank, stratum, key):
        nonlocal num_traces
        num_traces += 1
        draw = demonstrations(dynamics.build("bicycle_discrete"), vector(SMALL))
        return draw(bank, stratum, key)

    config = CloningConfig(batch_size=8, learning_rate=1e-3)
    learner = learners.build(config, agent, lambda past: env, sample)
    program = compile_program(learner, mesh, 2)
    state = initial_state(learner, mesh, jax.random.key(0), bank)
    state, metrics = program(state, bank)
    traces = num_traces
    with jax.transfer_guard("disallow"):
        for _ in range(3):
            state, metrics = program(state, bank)
    assert num_traces == traces
    assert int(state.step) == 8 and np.isfinite(metrics["loss"].total).all()

    evaluate = compile_evaluator(env, acting.greedy(agent, env), mesh)
    key = meshes.replicate(mesh, jax.random.key(0))
    episodes = evaluate(state.params, bank, key)
    assert len(episodes.value["collision"]) == len(worlds.scenarios("generated"))
