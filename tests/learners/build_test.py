"""Tests that configs become learners, and that wrong ones are named."""

import dataclasses
import typing

import pytest

from drivetrain.agents.build import Kind
from drivetrain.learners import build
from drivetrain.learners.bc import CloningConfig
from drivetrain.sim.dynamics.base import Continuous, Discrete
from tests.learners import probes, toy
from tests.learners.probes import NUM_ACTIONS

BOUNDS = Continuous(low=(-1.0,), high=(1.0,))


CONFIGS = {config: config() for config in typing.get_args(build.LearnerConfig)}


def test_each_learner_has_a_name_of_its_own() -> None:
    names = [config.name for config in CONFIGS.values()]
    assert sorted(names) == ["apg", "bc", "dqn", "ppo", "wayformer"]


@pytest.mark.parametrize("config", CONFIGS.values(), ids=lambda config: config.name)
def test_each_learner_is_built_with_what_it_asks_for(config) -> None:
    spec = BOUNDS if config.name in ("apg", "wayformer") else Discrete(NUM_ACTIONS)
    env = dataclasses.replace(probes.environment(probes.VALUE), action_spec=spec)
    made = build.build(
        config, toy.linear_agent(), lambda past: env, toy.sampler(toy.sign)
    )
    assert callable(made.init)
    assert build.kind_of(config) in typing.get_args(Kind)


@pytest.mark.parametrize("fields", [{"batch_size": 0}, {"batch_size": 12}])
def test_a_batch_that_strata_do_not_divide_is_refused(fields: dict) -> None:
    with pytest.raises(ValueError, match="batch_size must be a positive multiple"):
        CloningConfig(**fields)
