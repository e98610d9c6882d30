"""Tests of the action distributions against numeric integration and hand numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.distributions import SQUASHED_LIMIT, Categorical, TanhMixture
from drivetrain.sim.dynamics.base import Continuous

ROUNDING = 1e-5  # float32, values of order one
QUADRATURE = 1e-3  # midpoint rule on the grids below
NUM_SAMPLES = 20_000
SAMPLING = 4 / np.sqrt(NUM_SAMPLES)  # four standard errors of a frequency, at most


def mixture() -> TanhMixture:
    return TanhMixture(
        logits=jnp.log(jnp.array([0.3, 0.7])),
        mean=jnp.array([[-0.6, 0.4], [0.5, -0.2]]),
        scale=jnp.array([[0.3, 0.5], [0.4, 0.2]]),
        bounds=Continuous(low=(-2.0, 1.0), high=(4.0, 1.5)),
    )


def test_categorical_log_prob_is_the_softmax() -> None:
    distribution = Categorical(logits=jnp.log(jnp.array([1.0, 2.0, 5.0])) + 3)
    found = jnp.exp(jnp.stack([distribution.log_prob(jnp.array(i)) for i in range(3)]))
    np.testing.assert_allclose(found, [0.125, 0.25, 0.625], atol=ROUNDING)


def test_categorical_samples_are_as_frequent_as_likely() -> None:
    distribution = Categorical(logits=jnp.log(jnp.array([1.0, 2.0, 5.0])))
    keys = jax.random.split(jax.random.key(0), NUM_SAMPLES)
    frequency = (
        jnp.bincount(jax.vmap(distribution.sample)(keys), length=3) / NUM_SAMPLES
    )
    np.testing.assert_allclose(frequency, [0.125, 0.25, 0.625], atol=SAMPLING)


def test_categorical_mode_is_the_most_likely_action() -> None:
    assert Categorical(logits=jnp.array([0.0, 3.0, -1.0])).mode() == 1


def test_mixture_density_integrates_to_one() -> None:
    first = np.linspace(-2, 4, 402)
    second = np.linspace(1, 1.5, 402)
    middles = [(edges[1:] + edges[:-1]) / 2 for edges in (first, second)]
    actions = np.stack(np.meshgrid(*middles), axis=-1).reshape(-1, 2)
    density = jnp.exp(jax.vmap(mixture().log_prob)(jnp.array(actions, jnp.float32)))
    area = (first[1] - first[0]) * (second[1] - second[0])
    assert abs(density.sum() * area - 1) < QUADRATURE


def test_mixture_density_at_the_centre_is_that_of_the_normal() -> None:
    # One standard normal: y = 0 and u = 0, so p = 1/sqrt(2 pi) over the half range 3.
    distribution = TanhMixture(
        logits=jnp.zeros(1),
        mean=jnp.zeros((1, 1)),
        scale=jnp.ones((1, 1)),
        bounds=Continuous(low=(-2.0,), high=(4.0,)),
    )
    expected = np.log(1 / np.sqrt(2 * np.pi) / 3)
    assert abs(distribution.log_prob(jnp.array([1.0])) - expected) < ROUNDING


def test_mixture_samples_follow_its_density() -> None:
    keys = jax.random.split(jax.random.key(0), NUM_SAMPLES)
    samples = jax.vmap(mixture().sample)(keys)
    # P(first feature < 1) = P(u < 0): 0.3 Phi(2) + 0.7 Phi(-1.25), by a table of Phi.
    expected = 0.3 * 0.97725 + 0.7 * 0.10565
    assert abs((samples[:, 0] < 1).mean() - expected) < SAMPLING


def test_mixture_mode_is_the_centre_of_the_likeliest_component() -> None:
    expected = [1 + 3 * np.tanh(0.5), 1.25 + 0.25 * np.tanh(-0.2)]
    np.testing.assert_allclose(mixture().mode(), expected, atol=ROUNDING)


def test_actions_never_leave_the_bounds() -> None:
    wide = mixture().replace(scale=jnp.full((2, 2), 50.0))
    samples = jax.vmap(wide.sample)(jax.random.split(jax.random.key(0), 1000))
    assert (samples >= jnp.array([-2.0, 1.0])[None]).all()
    assert (samples <= jnp.array([4.0, 1.5])[None]).all()


@pytest.mark.parametrize("action", [(-2.0, 1.0), (4.0, 1.5), (1.0, 1.25), (99.0, -9.0)])
def test_mixture_log_prob_and_its_gradients_are_finite(action: tuple) -> None:
    def log_prob(distribution: TanhMixture, action: jax.Array) -> jax.Array:
        return distribution.log_prob(action)

    value, gradients = jax.value_and_grad(log_prob, argnums=(0, 1))(
        mixture(), jnp.array(action)
    )
    leaves = [value, *jax.tree.leaves(gradients)]
    assert all(jnp.isfinite(leaf).all() for leaf in leaves)


def test_an_action_on_the_bound_counts_as_one_just_inside() -> None:
    inside = jnp.array([1 + 3 * SQUASHED_LIMIT, 1.25])
    on_bound = mixture().log_prob(jnp.array([4.0, 1.25]))
    assert abs(on_bound - mixture().log_prob(inside)) < 0.01  # steep there


def numeric_entropy(distribution: TanhMixture) -> jax.Array:
    """Integrates -p log p over the bounds, by the midpoint rule."""
    bounds = distribution.bounds
    sides = [
        np.linspace(*side, 402) for side in zip(bounds.low, bounds.high, strict=True)
    ]
    middles = [(side[1:] + side[:-1]) / 2 for side in sides]
    actions = np.stack(np.meshgrid(*middles), axis=-1).reshape(-1, len(sides))
    log_prob = jax.vmap(distribution.log_prob)(jnp.array(actions, jnp.float32))
    area = np.prod([side[1] - side[0] for side in sides])
    return -jnp.sum(jnp.exp(log_prob) * log_prob) * area


def test_categorical_entropy_is_that_of_its_probabilities() -> None:
    distribution = Categorical(logits=jnp.log(jnp.array([1.0, 2.0, 5.0, 0.0])))
    # 1/8 ln 8 + 1/4 ln 4 + 5/8 ln 8/5; what cannot happen adds nothing.
    expected = (3 / 8 + 2 / 4) * np.log(2) + 5 / 8 * np.log(1.6)
    key = jax.random.key(0)
    assert abs(distribution.entropy(key) - expected) < ROUNDING
    slope = jax.grad(lambda logits: Categorical(logits=logits).entropy(key))
    # d H / d logit_i = -p_i (log p_i + H), and zero for what cannot happen.
    p = np.array([1.0, 2.0, 5.0]) / 8
    found = slope(distribution.logits)
    np.testing.assert_allclose(found[:3], -p * (np.log(p) + expected), atol=ROUNDING)
    assert found[3] == 0


def test_estimates_of_a_mixtures_entropy_have_the_right_mean() -> None:
    keys = jax.random.split(jax.random.key(0), NUM_SAMPLES)
    estimates = jax.jit(jax.vmap(mixture().entropy))(keys)
    error = 4 * estimates.std() / np.sqrt(NUM_SAMPLES)
    assert error < 0.02
    assert (
        abs(estimates.mean() - jax.jit(numeric_entropy)(mixture())) < error + QUADRATURE
    )


def test_slopes_of_a_mixtures_entropy_have_the_right_mean() -> None:
    # As the logits, the means and the scales change, so must the mean of the estimates.
    def estimate(distribution: TanhMixture, key: jax.Array) -> jax.Array:
        return distribution.entropy(key)

    keys = jax.random.split(jax.random.key(0), NUM_SAMPLES)
    slopes = jax.jit(jax.vmap(jax.grad(estimate), in_axes=(None, 0)))(mixture(), keys)
    expected = jax.jit(jax.grad(numeric_entropy))(mixture())
    for name in ("logits", "mean", "scale"):
        own, right = getattr(slopes, name), getattr(expected, name)
        error = 4 * own.std(axis=0) / np.sqrt(NUM_SAMPLES)
        assert (jnp.abs(own.mean(axis=0) - right) < error + QUADRATURE).all()


def test_the_entropy_of_actions_at_the_bounds_is_finite() -> None:
    def estimate(distribution: TanhMixture) -> jax.Array:
        return distribution.entropy(jax.random.key(0))

    far = mixture().replace(mean=jnp.full((2, 2), 40.0))
    value, slopes = jax.value_and_grad(estimate)(far)
    leaves = [value, *jax.tree.leaves(slopes)]
    assert all(jnp.isfinite(leaf).all() for leaf in leaves)
