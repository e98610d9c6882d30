"""Tests the terms of PPO's loss against numbers worked by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Agent, Output
from drivetrain.agents.distributions import Categorical
from drivetrain.learners import rehearsal, surrogate
from drivetrain.learners.rehearsal import Lesson, RehearsalConfig
from drivetrain.learners.returns import Worth
from drivetrain.learners.sequences import Note, Sequence

ROUNDING = 1e-6  # float32, numbers of order one


@pytest.mark.parametrize(
    ("ratio", "advantage", "gain"),
    [
        (1.0, 2.0, 2.0),
        (1.1, 2.0, 2.2),
        (1.5, 2.0, 2.4),  # no more is believed than 1.2
        (0.5, 2.0, 1.0),  # but every loss
        (0.5, -2.0, -1.6),  # no more is believed than 0.8
        (1.5, -2.0, -3.0),
    ],
)
def test_gains_are_believed_near_the_policy_that_acted(
    ratio: float, advantage: float, gain: float
) -> None:
    log_ratio = jnp.log(jnp.float32(ratio))
    found = surrogate.clipped(log_ratio, jnp.float32(advantage), 0.2)
    np.testing.assert_allclose(found, gain, rtol=ROUNDING)
    assert surrogate.is_clipped(log_ratio, 0.2) == (abs(ratio - 1) > 0.2)


def test_divergence_has_the_mean_of_the_true_one() -> None:
    old, new = np.array([0.2, 0.3, 0.5]), np.array([0.4, 0.4, 0.2])
    estimates = surrogate.divergence(jnp.log(jnp.array(new / old)))
    assert (estimates >= 0).all()
    expected = np.sum(old * np.log(old / new))
    np.testing.assert_allclose(old @ np.asarray(estimates), expected, rtol=ROUNDING)


def test_terms_by_hand() -> None:
    def step(params: jax.Array, memory: tuple, observation: dict):
        logits = jnp.log(jnp.array([0.25, 0.75]))
        return memory, Output(policy=Categorical(logits=logits), value=params)

    agent = Agent(init=lambda key: jnp.float32(0), memory=lambda: (), step=step)
    lesson = Lesson(
        sequence=Sequence(
            memory=(),
            observation={},
            action=jnp.array([1, 0, 1]),
            note=Note(log_prob=jnp.log(jnp.array([0.5, 0.5, 0.9])), value=jnp.zeros(3)),
            reward=jnp.zeros(3),
            discount=jnp.ones(3),
            mask=jnp.array([True, True, False]),
        ),
        worth=Worth(
            advantage=jnp.array([2.0, -4.0, 0]), target=jnp.array([3.0, -1, 0])
        ),
    )
    keys = jax.random.split(jax.random.key(0), 3)
    found = rehearsal.terms(agent, 0.2, jnp.float32(1.0), lesson, keys)
    # Ratios 1.5 and 0.5, and none where the mask is False.
    expected = {
        "policy_loss": [-2.4, 3.2, 0],
        "value_loss": [2.0, 2.0, 0.5],
        "entropy": [0.25 * np.log(4) + 0.75 * np.log(4 / 3)] * 3,
        "kl": [0.5 - np.log(1.5), -0.5 + np.log(2), 0],
        "clipped": [1, 1, 0],
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"epochs": 0}, "epochs must be at least 1"),
        ({"entropy_weight": -0.1}, "entropy_weight must be at least 0"),
        ({"clip": 0.0}, "clip must be positive"),
        ({"kl_limit": 0.0}, "kl_limit must be positive"),
    ],
)
def test_values_out_of_range_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RehearsalConfig(**fields)
