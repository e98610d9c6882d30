"""Turns features into the value of a state."""

from flax import nnx
from jaxtyping import Array, Float

from .initial import LAST_KERNEL


class ValueHead(nnx.Module):
    """One output."""

    def __init__(self, in_features: int, *, rngs: nnx.Rngs):
        """Draws parameters."""
        self.value = nnx.Linear(in_features, 1, kernel_init=LAST_KERNEL, rngs=rngs)

    def __call__(self, features: Float[Array, " features"]) -> Float[Array, ""]:
        """Returns the value given the features of one observation."""
        return self.value(features)[0]
