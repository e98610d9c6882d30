"""Tests of the agent as a whole: pure, and true to its action spec."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents import build
from drivetrain.agents.base import Agent
from drivetrain.agents.build import AgentConfig
from drivetrain.agents.distributions import Categorical, TanhMixture
from drivetrain.agents.encoders.flat import FlatConfig
from drivetrain.agents.encoders.wayformer import WayformerConfig
from drivetrain.sim.dynamics.base import Continuous, Discrete
from drivetrain.sim.observations.base import TokenGroup

SMALL = AgentConfig(
    encoder=WayformerConfig(width=8, num_heads=2, num_layers=1, num_latents=2),
    hidden_width=8,
)
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
        ({"hidden_width": 0}, "hidden_width must be at least 1, got 0"),
        ({"memory_width": -1}, "memory_width must be at least 0, got -1"),
    ],
)
def test_impossible_sizes_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AgentConfig(**fields)


@pytest.mark.parametrize("dueling", [False, True])
@pytest.mark.parametrize(("factored", "num_outputs"), [(False, 15), (True, 8)])
def test_action_values_are_greedy_policies(
    dueling: bool, factored: bool, num_outputs: int
) -> None:
    config = dataclasses.replace(SMALL, dueling=dueling, factored=factored)
    agent = build.build(config, OBSERVATION, Discrete(15, (3, 5)), "action_values")
    params = agent.init(jax.random.key(0))
    last = params["head"]["values"]["advantages" if dueling else "values"]
    assert last["bias"].shape == (num_outputs,)
    _, output = agent.step(params, agent.memory(), OBSERVATION)
    assert output.policy.values.shape == (15,)
    assert output.policy.mode() == jnp.argmax(output.policy.values)


def test_critics_share_all_but_the_last_layer_with_the_policy() -> None:
    alone = build.build(SMALL, OBSERVATION, Discrete(5))
    both = build.build(SMALL, OBSERVATION, Discrete(5), "actor_critic")
    shapes = [jax.eval_shape(a.init, jax.random.key(0)) for a in (alone, both)]
    assert shapes[1].pop("critic")
    assert shapes[0] == shapes[1]


def test_memory_of_the_last_step_changes_the_next_and_starts_at_zero() -> None:
    config = AgentConfig(
        encoder=FlatConfig(widths=(8,)), num_hidden_layers=0, memory_width=6
    )
    agent = build.build(config, OBSERVATION, Discrete(5))
    params = agent.init(jax.random.key(0))
    np.testing.assert_array_equal(agent.memory(), np.zeros(6))
    memory, first = agent.step(params, agent.memory(), OBSERVATION)
    _, second = agent.step(params, memory, OBSERVATION)
    assert (first.policy.logits != second.policy.logits).all()


def test_factored_actions_have_a_softmax_for_each_number() -> None:
    config = dataclasses.replace(SMALL, factored=True)
    agent = build.build(config, OBSERVATION, Discrete(15, (3, 5)))
    params = agent.init(jax.random.key(0))
    _, output = agent.step(params, agent.memory(), OBSERVATION)
    assert [len(logits) for logits in output.policy.logits] == [3, 5]


@pytest.mark.parametrize(
    ("kind", "factored"), [("policy", True), ("action_values", False)]
)
def test_heads_for_numbered_actions_refuse_others(
    kind: build.Kind, factored: bool
) -> None:
    config = dataclasses.replace(SMALL, factored=factored)
    with pytest.raises(ValueError, match="bicycle_discrete"):
        build.build(config, OBSERVATION, BOUNDS, kind)


def test_what_a_head_would_ignore_is_refused() -> None:
    dueling = dataclasses.replace(SMALL, dueling=True)
    with pytest.raises(ValueError, match="dueling=false"):
        build.build(dueling, OBSERVATION, Discrete(5))


def test_bounds_that_enclose_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match="low < high"):
        build.build(SMALL, OBSERVATION, Continuous(low=(1.0,), high=(1.0,)))
