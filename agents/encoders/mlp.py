"""Transforms an embedding by a residual multi-layer perceptron."""

import jax
from flax import nnx
from jaxtyping import Array, Float


class ResidualMLP(nnx.Module):
    """A projection to the hidden width, then layers each beside a shortcut.

        x_0 = P x,    x_l = x_{l-1} + W_l relu(norm(x_{l-1}))

    Gulino et al. 2023, A.2, say four residual layers of 128 and no more; the norm and
    the activation before the weights are ours.
    """

    def __init__(
        self, in_features: int, width: int, num_layers: int, *, rngs: nnx.Rngs
    ):
        """Draws parameters."""
        self.projection = nnx.Linear(in_features, width, rngs=rngs)
        self.norms = nnx.List(
            [nnx.LayerNorm(width, rngs=rngs) for _ in range(num_layers)]
        )
        self.layers = nnx.List(
            [nnx.Linear(width, width, rngs=rngs) for _ in range(num_layers)]
        )

    def __call__(self, x: Float[Array, " features"]) -> Float[Array, " width"]:
        """Transforms one embedding."""
        x = self.projection(x)
        for norm, layer in zip(self.norms, self.layers, strict=True):
            x = x + layer(jax.nn.relu(norm(x)))
        return x
