"""Tests that errors of the values of actions equal numbers worked by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rlax

from drivetrain.agents.base import Agent, Memory, Output
from drivetrain.agents.distributions import ActionValues
from drivetrain.learners import q_learning
from drivetrain.learners.transitions import Transition
from drivetrain.sim.env.demonstrations import Demonstration
from drivetrain.sim.observations.base import Observation, TokenGroup
from tests.learners import toy

ROUNDING = 1e-6  # relative, of float32


def see(*features: float) -> Observation:
    values = jnp.array(features)[None, None]
    return {"objects": TokenGroup(values=values, mask=jnp.ones((1, 1), bool))}


def linear() -> Agent:
    """Values of three actions, linear in two features."""

    def step(
        params: jax.Array, memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        values = observation["objects"].values[0, 0] @ params
        return memory, Output(policy=ActionValues(values=values), value=jnp.zeros(()))

    return Agent(init=lambda key: jnp.zeros((2, 3)), memory=lambda: (), step=step)


PARAMS = jnp.array([[1.0, 2.0, 3.0], [0.0, 5.0, 1.0]])
TARGET = jnp.array([[10.0, 20.0, 30.0], [1.0, 2.0, 4.0]])
# Seen first: values (1, 2, 3). Seen last: (0, 5, 1), so action 1 is best, and worth 2
# to the target, whose own best would be 4.
TRANSITION = Transition(
    observation_t=see(1.0, 0.0),
    action_t=jnp.int32(2),
    return_t=jnp.float32(7.0),
    discount_tpn=jnp.float32(0.5),
    observation_tpn=see(0.0, 1.0),
)


def test_the_error_is_that_of_double_q_learning() -> None:
    error, value = q_learning.td_error(linear(), PARAMS, TARGET, TRANSITION)
    assert (float(error), float(value)) == (7 + 0.5 * 2 - 3, 3)


def test_the_gradient_is_of_the_value_alone() -> None:
    def half_square(params: jax.Array) -> jax.Array:
        error, _ = q_learning.td_error(linear(), params, TARGET, TRANSITION)
        return error**2 / 2

    # Minus the error, where feature and action meet.
    expected = np.zeros((2, 3))
    expected[0, 2] = -5
    np.testing.assert_array_equal(jax.grad(half_square)(PARAMS), expected)


def test_the_loss_is_the_mean_over_what_was_drawn() -> None:
    weights = jnp.array([1.0, 0.5, 0.0])
    errors = jnp.array([2.0, -4.0, jnp.nan])
    means = q_learning.means(weights, errors, jnp.array([3.0, 5.0, 100.0]))
    found = {name: float(mean.total / mean.weight) for name, mean in means.items()}
    assert found == {"loss": (2 + 4) / 2, "td_error": 3, "value": 4}
    squares = jax.vmap(rlax.l2_loss)(errors[:2]) * weights[:2]
    np.testing.assert_allclose(found["loss"], squares.mean(), rtol=ROUNDING)


def test_the_loss_of_large_errors_is_linear() -> None:
    # 1.5^2 / 2 within the limit of 2; beyond it 2 (5 - 1); both by their weights.
    weights, errors = jnp.array([2.0, 0.5, 0.0]), jnp.array([1.5, -5.0, jnp.nan])

    def loss(errors):
        mean = q_learning.means(weights, errors, jnp.zeros(3), huber=2.0)["loss"]
        return mean.total / mean.weight

    np.testing.assert_allclose(loss(errors), (2.25 + 4) / 2, rtol=ROUNDING)
    slope = np.asarray(jax.grad(loss)(errors))[:2]
    np.testing.assert_allclose(slope, [2 * 1.5 / 2, -0.5 * 2 / 2], rtol=ROUNDING)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((1.0, 5.0, 2.0), 5 + 0.8 - 2),  # another is better
        ((1.0, 1.5, 2.0), 1.5 + 0.8 - 2),  # the expert's is better, by too little
        ((1.0, 1.0, 2.0), 0.0),
    ],
)
def test_the_margin_is_that_of_demonstrations(
    values: tuple[float, ...], expected: float
) -> None:
    found = q_learning.expert_margin(jnp.array(values), jnp.int32(2), 0.8)
    np.testing.assert_allclose(found, expected, rtol=ROUNDING)


def test_demonstrations_count_by_their_weight() -> None:
    shown = Demonstration(
        observation=jax.tree.map(
            lambda *leaves: jnp.stack(leaves), see(1.0, 0.0), see(0.0, 1.0)
        ),
        action=jnp.array([2, 0]),
        weight=jnp.array([3.0, 1.0]),
    )
    mean = q_learning.imitation(linear(), PARAMS, shown, margin=2.0)
    # Values (1, 2, 3): 2 + 2 - 3 = 1. Values (0, 5, 1): 5 + 2 - 0 = 7.
    assert (float(mean.total), float(mean.weight)) == (3 * 1 + 7, 4)


def test_an_agent_without_values_of_actions_is_refused() -> None:
    agent = toy.softmax(lambda key: jnp.zeros(2), lambda params, _: params)
    with pytest.raises(TypeError, match="must return ActionValues, got Categorical"):
        q_learning.action_values(agent, jnp.zeros(2), see(1.0, 0.0))
