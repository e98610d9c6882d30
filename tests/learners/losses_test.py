"""Tests of sums under weights and of the distance between actions."""

import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.distributions import ActionValues, Categorical, TanhMixture
from drivetrain.agents.factored import FactoredCategorical
from drivetrain.learners import losses
from drivetrain.sim.dynamics.base import Continuous

ROUNDING = 1e-6  # float32, values of order one


def test_values_of_no_weight_do_not_count_even_when_not_finite() -> None:
    values = jnp.array([1.0, jnp.inf, 3.0])
    mean = losses.weighted(values, jnp.array([2.0, 0.0, 0.5]))
    assert (mean.total, mean.weight) == (3.5, 2.5)


def test_numbered_actions_are_right_or_wrong() -> None:
    distribution = Categorical(logits=jnp.array([0.0, 2.0, 1.0]))
    assert losses.imitation_error(distribution, jnp.array(1))["accuracy"] == 1
    assert losses.imitation_error(distribution, jnp.array(2))["accuracy"] == 0


def test_the_error_of_continuous_actions_is_a_fraction_of_the_range() -> None:
    distribution = TanhMixture(
        logits=jnp.zeros(1),
        mean=jnp.zeros((1, 2)),
        scale=jnp.ones((1, 2)),
        bounds=Continuous(low=(-6.0, 0.0), high=(6.0, 1.0)),
    )
    # The mode is the middle (0, 0.5): off by 3 of 12 and by 0.25 of 1.
    error = losses.imitation_error(distribution, jnp.array([3.0, 0.25]))
    np.testing.assert_allclose(error["absolute_error"], 0.25, atol=ROUNDING)


@pytest.mark.parametrize("kind", ["categorical", "factored", "values"])
def test_label_smoothing_mixes_the_action_with_all(kind: str) -> None:
    rng = np.random.default_rng(0)
    factors = [rng.normal(size=count) for count in (2, 3)]
    joint = (factors[0][:, None] + factors[1][None]).ravel()
    logits = jnp.asarray(joint, jnp.float32)
    policy = {
        "categorical": Categorical(logits=logits),
        "factored": FactoredCategorical(
            logits=tuple(jnp.asarray(f, jnp.float32) for f in factors)
        ),
        "values": ActionValues(values=logits),
    }[kind]
    log_prob = joint - np.log(np.exp(joint).sum())
    target = np.full(6, 0.1 / 6) + 0.9 * np.eye(6)[4]
    found = losses.surprise(policy, jnp.int32(4), 0.1)
    np.testing.assert_allclose(found, -(target * log_prob).sum(), rtol=ROUNDING)
