"""Tests that forecasts learn the trajectory nearest to what came."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents import build as agents, plan
from drivetrain.agents.base import Agent
from drivetrain.agents.build import AgentConfig
from drivetrain.agents.encoders.wayformer import WayformerConfig
from drivetrain.agents.heads.trajectory import TrajectoryConfig
from drivetrain.agents.planner import PlannerConfig
from drivetrain.agents.trajectories import Trajectories
from drivetrain.learners import acting, bc, forecasting, mesh as meshes, optim, program
from drivetrain.learners.base import Learner
from drivetrain.learners.evaluator import compile_evaluator
from drivetrain.sim.env.futures import Future
from tests import worlds
from tests.learners import evaluator_test, toy
from tests.sim.env.planning_test import env_of

NORMAL = -0.5 * np.log(2 * np.pi)  # logarithm of the standard normal's peak
ROUNDING = 1e-5  # float32, values of order ten
NUM_STEPS = 3
SMALL = AgentConfig(
    encoder=WayformerConfig(width=16, num_heads=2, num_layers=1, num_latents=2),
    trajectory=TrajectoryConfig(
        num_modes=4, num_steps=NUM_STEPS, num_layers=1, num_heads=2
    ),
    planner=PlannerConfig(num_steps=2, num_modes=2),
)
CONFIG = forecasting.ForecastConfig(batch_size=64, learning_rate=1e-2)


def test_the_loss_and_its_companions_by_hand() -> None:
    forecast = Trajectories(
        logits=jnp.log(jnp.array([0.2, 0.6])),
        mean=jnp.array([[[0.0, 0.0, 0.0]] * 2, [[3.0, 4.0, 0.0]] * 2]),
        scale=jnp.ones((2, 2, 3)),
    )
    poses = jnp.array([[1.0, 0.0, 0.5], [jnp.nan] * 3])
    found = forecasting.terms(forecast, poses, jnp.array([True, False]))
    expected = {
        "loss": -np.log(0.25) - (3 * NORMAL - 0.5 * (1 + 0.25)),
        "min_ade": 1.0,
        "ade": np.hypot(2, 4),
        "accuracy": 0.0,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, atol=ROUNDING)


def forked(bank, stratum, key) -> Future:
    """Goes left or right, one as likely as the other, one step in three unseen."""
    del bank, stratum
    side_key, mask_key = jax.random.split(key)
    side = jnp.where(jax.random.bernoulli(side_key), 1.0, -1.0)
    steps = jnp.arange(1.0, NUM_STEPS + 1)
    poses = jnp.stack([5 * steps, 2 * side * steps, 0.3 * side * steps], axis=1)
    mask = jnp.arange(NUM_STEPS) < jax.random.randint(mask_key, (), 2, NUM_STEPS + 1)
    values = jnp.ones((toy.NUM_TOKENS, toy.NUM_STEPS, toy.NUM_FEATURES))
    return Future(
        observation=toy.first_token(values),
        poses=jnp.where(mask[:, None], poses, jnp.nan),
        mask=mask,
    )


def learner_of(agent: Agent, optimizer: optim.Optimizer) -> Learner:
    return forecasting.forecasting(agent, forked, optimizer, CONFIG)


def forecaster() -> Agent:
    observation = forked(None, None, jax.random.key(0)).observation
    return agents.build(SMALL, observation, plan.ACTION_SPEC, "trajectories")


def test_it_learns_both_ways_of_a_fork() -> None:
    observation = forked(None, None, jax.random.key(0)).observation
    agent = forecaster()
    learner = learner_of(agent, optim.adam(CONFIG))
    mesh = meshes.data_mesh()
    run = program.compile_program(learner, mesh, updates_per_call=300)
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    state = program.initial_state(learner, mesh, jax.random.key(0), bank)
    state, _ = run(state, bank)

    _, output = agent.step(state.params, agent.memory(), observation)
    forecast = output.policy.forecast
    for side in (2.0, -2.0):
        is_near = jnp.abs(forecast.mean[:, -1, 1] - 3 * side) < 1
        assert abs(forecast.probability()[is_near].sum() - 0.5) < 0.15


def test_agents_that_plan_nothing_are_refused() -> None:
    batch = jax.tree.map(lambda leaf: leaf[None], forked(None, None, jax.random.key(0)))
    agent = toy.linear_agent()
    params = agent.init(jax.random.key(0))
    with pytest.raises(
        TypeError, match=r"needs an agent that plans, got .* Categorical"
    ):
        forecasting.forecast_metrics(agent, params, batch)


def test_plans_cannot_be_cloned() -> None:
    future = forked(None, None, jax.random.key(0))
    agent = agents.build(SMALL, future.observation, plan.ACTION_SPEC, "trajectories")
    demonstration = bc.Demonstration(
        observation=future.observation, action=jnp.zeros(3), weight=jnp.ones(())
    )
    batch = jax.tree.map(lambda leaf: leaf[None], demonstration)
    with pytest.raises(TypeError, match="a plan is no distribution"):
        bc.imitation(agent, agent.init(jax.random.key(0)), batch)


def test_planners_drive_whole_evaluations() -> None:
    env, bank, mesh = env_of("delta"), evaluator_test.sharded(), meshes.data_mesh()
    local = worlds.bank("generated")
    state = jax.jit(env.reset)(local, jnp.int32(0), jax.random.key(0))
    agent = agents.build(
        SMALL, env.observe(local, state), env.action_spec, "trajectories"
    )
    params = meshes.replicate(mesh, agent.init(jax.random.key(0)))
    keep = lambda steps: steps.action  # noqa: E731 (one line)
    evaluate = compile_evaluator(env, acting.greedy(agent, env), mesh, keep)
    actions = evaluate(params, bank, meshes.replicate(mesh, jax.random.key(0)))
    assert np.isfinite(actions).all()
    assert (np.abs(np.diff(actions, axis=1)).sum(axis=2) > 0).any()
