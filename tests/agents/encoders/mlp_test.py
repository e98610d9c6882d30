"""Tests of the residual perceptron against its equation."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from drivetrain.agents.encoders.mlp import ResidualMLP

ROUNDING = 1e-5  # float32 sums of a dozen terms of order one
NORM_EPSILON = 1e-6


def test_each_layer_adds_to_what_it_is_given() -> None:
    mlp = ResidualMLP(3, 6, 2, rngs=nnx.Rngs(0))
    features = jax.random.normal(jax.random.key(1), (3,))

    x = np.asarray(features, np.float64) @ np.asarray(mlp.projection.kernel[...])
    for layer in mlp.layers:
        normed = (x - x.mean()) / np.sqrt(x.var() + NORM_EPSILON)
        x = x + np.maximum(normed, 0) @ np.asarray(layer.kernel[...])

    np.testing.assert_allclose(mlp(features), x, atol=ROUNDING)


def test_a_layer_of_zeros_passes_its_input_on() -> None:
    mlp = ResidualMLP(3, 6, 1, rngs=nnx.Rngs(0))
    mlp.layers[0].kernel[...] = jnp.zeros((6, 6))
    features = jax.random.normal(jax.random.key(1), (3,))
    np.testing.assert_array_equal(mlp(features), mlp.projection(features))
