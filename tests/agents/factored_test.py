"""Tests of factored choices against the softmax over all joint actions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.factored import FactoredCategorical
from drivetrain.agents.heads.factored import FactoredCategoricalHead
from drivetrain.sim.dynamics import discretize
from drivetrain.sim.dynamics.base import Continuous

ROUNDING = 1e-5  # float32, logarithms of order one to ten
NUM_SAMPLES = 20_000
SAMPLING = 4 / np.sqrt(NUM_SAMPLES)  # four standard errors of a frequency, at most
BINS = (3, 4)


def distribution() -> FactoredCategorical:
    keys = jax.random.split(jax.random.key(0), len(BINS))
    return FactoredCategorical(
        logits=tuple(
            jax.random.normal(k, (n,)) for k, n in zip(keys, BINS, strict=True)
        )
    )


def joint() -> np.ndarray:
    """Returns the probabilities of all actions, row by row."""
    first, second = (np.exp(np.asarray(x, float)) for x in distribution().logits)
    table = np.outer(first, second)
    return (table / table.sum()).ravel()


def test_log_prob_is_that_of_the_joint_softmax() -> None:
    found = jax.vmap(distribution().log_prob)(jnp.arange(12))
    np.testing.assert_allclose(found, np.log(joint()), atol=ROUNDING)


def test_samples_are_as_frequent_as_likely() -> None:
    keys = jax.random.split(jax.random.key(1), NUM_SAMPLES)
    samples = jax.jit(jax.vmap(distribution().sample))(keys)
    frequency = np.bincount(samples, minlength=12) / NUM_SAMPLES
    np.testing.assert_allclose(frequency, joint(), atol=SAMPLING)


def test_mode_is_the_most_likely_joint_action() -> None:
    assert distribution().mode() == joint().argmax()


def test_entropy_is_that_of_the_joint_softmax() -> None:
    expected = -np.sum(joint() * np.log(joint()))
    np.testing.assert_allclose(
        distribution().entropy(jax.random.key(0)), expected, atol=ROUNDING
    )


def test_actions_are_numbered_as_discrete_dynamics_number_them() -> None:
    spec = Continuous(low=(0.0, 0.0), high=(2.0, 3.0))
    sure = FactoredCategorical(
        logits=(jnp.array([0.0, 0.0, 50.0]), jnp.array([0.0, 50.0, 0.0, 0.0]))
    )
    action = discretize.to_action(sure.mode(), spec, BINS)
    np.testing.assert_array_equal(action, [2.0, 1.0])


def test_the_head_has_a_softmax_per_factor() -> None:
    head = FactoredCategoricalHead(8, (15, 43), rngs=nnx.Rngs(0))
    found = head(jnp.ones(8))
    assert [logits.shape for logits in found.logits] == [(15,), (43,)]
    # Small last weights: at first all 645 actions are about as likely.
    assert abs(found.entropy(jax.random.key(0)) - np.log(645)) < 0.1


@pytest.mark.parametrize("num_bins", [(), (3, 0)])
def test_a_factor_without_bins_is_refused(num_bins: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="num_bins must be one number of at least 1"):
        FactoredCategoricalHead(8, num_bins, rngs=nnx.Rngs(0))
