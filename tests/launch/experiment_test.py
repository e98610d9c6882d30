"""Tests that the experiments of `configs/` are whole and fit together."""

import dataclasses
import functools
import importlib.resources

import jax
import jax.numpy as jnp
import pytest

from drivetrain.agents.build import AgentConfig
from drivetrain.agents.encoders.flat import FlatConfig
from drivetrain.launch import config
from drivetrain.launch.experiment import Experiment, agent, environment, keys, learner
from drivetrain.learners import mesh as meshes, program
from drivetrain.learners.apg import AnalyticConfig
from drivetrain.learners.bc import CloningConfig
from drivetrain.learners.dqn import DQNConfig
from drivetrain.learners.opponents import OpponentsConfig
from drivetrain.learners.ppo import PPOConfig
from drivetrain.sim.data.stream import StreamConfig
from drivetrain.sim.env.build import PlanningConfig, SelfPlayConfig, ShapingConfig
from tests import worlds

NAMES = sorted(
    path.name
    for path in importlib.resources.files("drivetrain.configs").iterdir()
    if path.name.endswith(".yaml")
)


@pytest.mark.parametrize("name", NAMES)
def test_every_config_is_of_parts_that_fit(name: str) -> None:
    path = importlib.resources.files("drivetrain.configs") / name
    experiment = config.from_yaml(path.read_text(), Experiment, source=name)
    bank = worlds.bank("generated")
    env = environment(experiment)
    made = agent(experiment, env, jax.eval_shape(lambda: bank))
    assert learner(experiment, env, made)
    assert jax.eval_shape(made.init, jax.random.key(0))
    assert keys(experiment).size == experiment.seeds


@pytest.mark.parametrize("name", NAMES)
def test_every_config_says_what_it_is_on_what_and_by_which_command(name: str) -> None:
    path = importlib.resources.files("drivetrain.configs") / name
    lines = path.read_text().splitlines()
    header = " ".join(line for line in lines if line.startswith("#"))
    assert "Hardware:" in header and "Command" in header
    assert f"configs/{name}" in header or "drivetrain demo" in header


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"opponents": OpponentsConfig(idm=0.5, myself=0.5)}, "met in self-play"),
        (
            {
                "task": SelfPlayConfig(sim_agent="idm"),
                "opponents": OpponentsConfig(idm=0.5, myself=0.5),
            },
            "sim_agent must be playback, got idm",
        ),
        (
            {
                "task": SelfPlayConfig(),
                "opponents": OpponentsConfig(past=0.5, myself=0.5),
                "learner": PPOConfig(),
            },
            r"got 0\.5 and 0",
        ),
        (
            {"task": SelfPlayConfig(), "learner": PPOConfig(num_pasts=2)},
            r"got 0\.0 and 2",
        ),
    ],
)
def test_opponents_who_would_not_be_met_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Experiment(data="none", **fields)


def test_a_learner_against_a_mixture_is_one_program() -> None:
    mixed = Experiment(
        data="none",
        task=SelfPlayConfig(),
        opponents=OpponentsConfig(myself=0.5, past=0.25, idm=0.25),
        agent=AgentConfig(encoder=FlatConfig(widths=(8,))),
        learner=PPOConfig(num_pasts=2, num_worlds=8, steps_per_update=4),
    )
    mesh, one = meshes.data_mesh(), worlds.bank("generated")
    bank = jax.tree.map(lambda leaf: jnp.stack([leaf] * mesh.size), one)
    env = environment(mixed)
    made = learner(mixed, env, agent(mixed, env, jax.eval_shape(lambda: one)))
    begin = functools.partial(program.initial_state, made, mesh)
    state = jax.eval_shape(begin, keys(mixed), bank)
    run = program.compile_program(made, mesh, updates_per_call=2)
    after, metrics = jax.eval_shape(run, state, bank)
    assert jax.tree.map(jnp.shape, after) == jax.tree.map(jnp.shape, state)
    assert metrics["loss"].total.shape == (2,)


@pytest.mark.parametrize(
    ("learner", "steps"),
    [
        (PPOConfig(epochs=3, minibatches=8, decay_updates=2399), 24),
        (DQNConfig(num_worlds=128, steps_per_update=4, decay_updates=6399), 64),
        (CloningConfig(decay_updates=99), 1),
    ],
)
def test_a_rate_that_would_be_zero_too_early_is_refused(learner, steps: int) -> None:
    counts = {"updates": 100, "updates_per_call": 10, "updates_per_checkpoint": 10}
    with pytest.raises(ValueError, match=f"set it to {100 * steps}"):
        Experiment(data="none", learner=learner, **counts)
    enough = dataclasses.replace(learner, decay_updates=100 * steps)
    assert Experiment(data="none", learner=enough, **counts)


def test_shaping_has_the_discount_of_the_learner() -> None:
    task = PlanningConfig(shaping=ShapingConfig(discount=0.9))
    assert Experiment(data="none", task=task, learner=PPOConfig(discount=0.9))
    with pytest.raises(ValueError, match=r"got 0\.9 and 0\.5"):
        Experiment(data="none", task=task, learner=PPOConfig(discount=0.5))
    with pytest.raises(ValueError, match=r"must be 1 for apg.*got 0\.9 and 1\.0"):
        Experiment(data="none", task=task, learner=AnalyticConfig())


def test_what_a_learner_cannot_do_is_refused() -> None:
    settled = PlanningConfig(settled_at=("collision",))
    assert Experiment(data="none", task=settled, learner=PPOConfig())
    with pytest.raises(ValueError, match="nothing settles one"):
        Experiment(data="none", task=settled, learner=AnalyticConfig())
    stream = StreamConfig(resident=8)
    assert Experiment(data="none", stream=stream)
    with pytest.raises(ValueError, match="ppo plays on while pages are exchanged"):
        Experiment(data="none", stream=stream, learner=PPOConfig())
