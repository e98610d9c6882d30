"""Tests of the agent as a whole: pure, and true to its action spec."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents import build
from drivetrain.agents.base import Agent
from drivetrain.agents.build import AgentConfig
from drivetrain.agents.distributions import Categorical, TanhMixture
from drivetrain.sim.dynamics.base import Continuous, Discrete
from drivetrain.sim.observations.base import TokenGroup

SMALL = AgentConfig(width=8, num_heads=2, num_layers=1, num_latents=2, hidden_width=8)
BOUNDS = Continuous(low=(-6.0, -0.3), high=(6.0, 0.3))
OBSERVATION = {
    "ego": TokenGroup(values=jnp.ones((1, 3, 4)), mask=jnp.ones((1, 3), bool))
}


def policy(agent: Agent) -> Categorical | TanhMixture:
    params = agent.init(jax.random.key(0))
    _, output = agent.step(params, agent.memory(), OBSERVATION)
    return output.policy


def test_the_agent_is_built_from_shapes_alone() -> None:
    shapes = jax.eval_shape(lambda: OBSERVATION)
    agent = build.build(SMALL, shapes, Discrete(5))
    params = agent.init(jax.random.key(0))
    expected = build.build(SMALL, OBSERVATION, Discrete(5)).init(jax.random.key(0))
    jax.tree.map(np.testing.assert_array_equal, params, expected)


def test_numbered_actions_have_one_logit_each_and_start_nearly_alike() -> None:
    agent = build.build(SMALL, OBSERVATION, Discrete(5))
    distribution = policy(agent)
    assert isinstance(distribution, Categorical)
    assert distribution.logits.shape == (5,)
    assert jnp.ptp(distribution.logits) < 1


def test_continuous_actions_come_from_a_mixture_between_the_bounds() -> None:
    agent = build.build(SMALL, OBSERVATION, BOUNDS)
    distribution = policy(agent)
    assert isinstance(distribution, TanhMixture)
    assert distribution.mean.shape == (SMALL.num_components, 2)
    assert distribution.bounds == BOUNDS
    assert (jnp.ptp(distribution.mean, axis=0) > 0).all()


def test_the_key_decides_the_parameters() -> None:
    agent = build.build(SMALL, OBSERVATION, Discrete(5))
    one, other = agent.init(jax.random.key(0)), agent.init(jax.random.key(1))
    kernels = [p["head"]["logits"]["kernel"] for p in (one, other)]
    assert (kernels[0] != kernels[1]).all()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"width": 10, "num_heads": 4}, "num_heads must divide width"),
        ({"num_latents": 0}, "num_latents must be at least 1, got 0"),
    ],
)
def test_impossible_sizes_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build.build(AgentConfig(**fields), OBSERVATION, Discrete(5))


def test_bounds_that_enclose_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="low < high"):
        build.build(SMALL, OBSERVATION, Continuous(low=(1.0,), high=(1.0,)))
