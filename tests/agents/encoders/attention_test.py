"""Tests of attention against a plain NumPy loop, and of its mask."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.encoders.attention import Attention, AttentionBlock

WIDTH, NUM_HEADS = 12, 3
ROUNDING = 1e-5  # float32 sums of a few dozen terms of order one


def attention() -> Attention:
    module = Attention(WIDTH, NUM_HEADS, rngs=nnx.Rngs(0))
    # Biases start at zero, where they agree with any use of them.
    for linear in (module.query, module.out):
        linear.bias[...] = jnp.linspace(-1.0, 1.0, WIDTH)
    return module


def inputs(num_queries: int = 4) -> tuple[jax.Array, jax.Array, jax.Array]:
    query_key, token_key = jax.random.split(jax.random.key(1))
    queries = 2 * jax.random.normal(query_key, (num_queries, WIDTH))
    tokens = 2 * jax.random.normal(token_key, (7, WIDTH))
    return queries, tokens, jnp.array([1, 1, 0, 1, 0, 1, 1], bool)


def textbook(module: Attention, queries, tokens, mask) -> np.ndarray:
    """Projects every token to keys and values, head by head, in float64."""

    def project(linear: nnx.Linear, x) -> np.ndarray:
        projected = np.asarray(x, np.float64) @ np.asarray(linear.kernel[...])
        return projected if linear.bias is None else projected + linear.bias[...][None]

    depth = WIDTH // NUM_HEADS
    tokens = np.asarray(tokens)[np.asarray(mask)]
    query, key = project(module.query, queries), project(module.key, tokens)
    value = project(module.value, tokens)
    heads = []
    for start in range(0, WIDTH, depth):
        part = slice(start, start + depth)
        scores = np.exp(query[:, part] @ key[:, part].T / np.sqrt(depth))
        heads.append(scores / scores.sum(axis=1, keepdims=True) @ value[:, part])
    return project(module.out, np.concatenate(heads, axis=1))


# Few queries meet tokens as they are, many meet them projected.
@pytest.mark.parametrize("num_queries", [4, 40])
def test_attention_is_that_of_the_textbook(num_queries: int) -> None:
    module, arguments = attention(), inputs(num_queries)
    expected = textbook(module, *arguments)
    np.testing.assert_allclose(module(*arguments), expected, atol=ROUNDING)


def test_large_scores_stay_finite() -> None:
    module, (queries, tokens, mask) = attention(), inputs()
    assert jnp.isfinite(module(1e3 * queries, 1e3 * tokens, mask)).all()


@pytest.mark.parametrize("num_queries", [4, 40])
def test_without_any_token_the_output_is_the_bias(num_queries: int) -> None:
    module, (queries, tokens, mask) = attention(), inputs(num_queries)
    gathered = module(queries, tokens, jnp.zeros_like(mask))
    expected = jnp.broadcast_to(module.out.bias[...], gathered.shape)
    np.testing.assert_array_equal(gathered, expected)


@pytest.mark.parametrize("num_queries", [4, 40])
def test_gradients_without_any_token_are_finite(num_queries: int) -> None:
    module, (queries, tokens, mask) = attention(), inputs(num_queries)
    graphdef, state = nnx.split(module)

    def total(state, queries, tokens):
        merged = nnx.merge(graphdef, state)
        return merged(queries, tokens, jnp.zeros_like(mask)).sum()

    gradients = jax.grad(total, argnums=(0, 1, 2))(state, queries, tokens)
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(gradients))


def test_a_masked_token_has_no_gradient() -> None:
    block = AttentionBlock(WIDTH, NUM_HEADS, 2, rngs=nnx.Rngs(0))
    queries, tokens, mask = inputs()
    gradient = jax.grad(lambda tokens: (block(queries, tokens, mask) ** 2).sum())(
        tokens
    )
    np.testing.assert_array_equal(jnp.any(gradient != 0, axis=1), mask)
