"""Turns features into the value of a state."""

from flax import nnx
from jaxtyping import Array, Float

# Small last weights: at first values hardly depend on the observation, so that early
# errors of returns are theirs and not the network's.
LAST_KERNEL = nnx.initializers.variance_scaling(0.01, "fan_in", "normal")


class ValueHead(nnx.Module):
    """One output."""

    def __init__(self, in_features: int, *, rngs: nnx.Rngs):
        """Draws parameters."""
        self.value = nnx.Linear(in_features, 1, kernel_init=LAST_KERNEL, rngs=rngs)

    def __call__(self, features: Float[Array, " features"]) -> Float[Array, ""]:
        """Returns the value given the features of one observation."""
        return self.value(features)[0]
