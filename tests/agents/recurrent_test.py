"""Tests of the memory against its equations."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from drivetrain.agents.recurrent import GRU

ROUNDING = 1e-5  # float32, a few steps of sums of eight terms of order one
WIDTH, FEATURES, STEPS = 5, 3, 4


def gru() -> GRU:
    module = GRU(FEATURES, WIDTH, rngs=nnx.Rngs(0))
    module.input.bias[...] = jnp.linspace(-1.0, 1.0, 3 * WIDTH)
    return module


def test_memories_follow_the_equations() -> None:
    module = gru()
    xs = jax.random.normal(jax.random.key(1), (STEPS, FEATURES))
    w = np.asarray(module.input.kernel[...], float).reshape(FEATURES, 3, WIDTH)
    b = np.asarray(module.input.bias[...], float).reshape(3, WIDTH)
    u = np.asarray(module.memory.kernel[...], float).reshape(WIDTH, 3, WIDTH)

    h, expected = np.zeros(WIDTH), []
    for x in np.asarray(xs, float):
        r, z = (1 / (1 + np.exp(-(x @ w[:, i] + b[i] + h @ u[:, i]))) for i in (0, 1))
        n = np.tanh(x @ w[:, 2] + b[2] + r * (h @ u[:, 2]))
        h = z * h + (1 - z) * n
        expected.append(h)

    last, outputs = jax.lax.scan(module, module.initial(), xs)
    np.testing.assert_allclose(outputs, expected, atol=ROUNDING)
    np.testing.assert_array_equal(last, outputs[-1])


def test_a_batch_equals_a_loop() -> None:
    module = gru()
    memories = jax.random.normal(jax.random.key(1), (3, WIDTH))
    xs = jax.random.normal(jax.random.key(2), (3, FEATURES))
    looped = jnp.stack([module(h, x)[0] for h, x in zip(memories, xs, strict=True)])
    np.testing.assert_allclose(jax.vmap(module)(memories, xs)[0], looped, atol=ROUNDING)


def test_each_gate_keeps_the_length_of_a_memory() -> None:
    kernel = np.asarray(gru().memory.kernel[...])
    for gate in np.split(kernel, 3, axis=1):
        np.testing.assert_allclose(gate @ gate.T, np.eye(WIDTH), atol=ROUNDING)
