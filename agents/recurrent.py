"""Remembers what was seen: a cell from one step to the next."""

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, DTypeLike, Float, Key


class GRU(nnx.Module):
    """A gated recurrent unit (Cho et al. 2014, section 2.3).

        r = sigmoid(W_r x + U_r h + b_r)
        z = sigmoid(W_z x + U_z h + b_z)
        n = tanh(W_n x + b_n + r * (U_n h))
        h' = z h + (1 - z) n

    with biases, which the paper leaves out.
    """

    def __init__(self, in_features: int, width: int, *, rngs: nnx.Rngs):
        """Draws parameters; those of the memory are orthogonal."""
        self.width = width
        self.input = nnx.Linear(in_features, 3 * width, rngs=rngs)
        self.memory = nnx.Linear(
            width, 3 * width, use_bias=False, kernel_init=_orthogonal_gates, rngs=rngs
        )

    def initial(self) -> Float[Array, " width"]:
        """Returns the memory at the start of an episode."""
        return jnp.zeros(self.width)

    def __call__(
        self, memory: Float[Array, " width"], x: Float[Array, " features"]
    ) -> tuple[Float[Array, " width"], Float[Array, " width"]]:
        """Returns the memory after a step, and the output, which is the same."""
        input_r, input_z, input_n = jnp.split(self.input(x), 3)
        memory_r, memory_z, memory_n = jnp.split(self.memory(memory), 3)
        reset = jax.nn.sigmoid(input_r + memory_r)
        keep = jax.nn.sigmoid(input_z + memory_z)
        new = jnp.tanh(input_n + reset * memory_n)
        memory = keep * memory + (1 - keep) * new
        return memory, memory


def _orthogonal_gates(key: Key[Array, ""], shape: tuple[int, int], dtype: DTypeLike):
    """Draws U_r, U_z and U_n, each of which keeps the length of a memory."""
    square = (shape[0], shape[0])
    orthogonal = nnx.initializers.orthogonal()
    gates = [orthogonal(k, square, dtype) for k in jax.random.split(key, 3)]
    return jnp.concatenate(gates, axis=1)
