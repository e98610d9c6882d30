"""Turns features into the values of numbered actions."""

from flax import nnx
from jaxtyping import Array, Float

from .initial import LAST_KERNEL


class ActionValueHead(nnx.Module):
    """One output per action."""

    def __init__(self, in_features: int, num_actions: int, *, rngs: nnx.Rngs):
        """Draws parameters."""
        self.values = nnx.Linear(
            in_features, num_actions, kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(self, features: Float[Array, " features"]) -> Float[Array, " actions"]:
        """Returns the value of each action given the features of one observation."""
        return self.values(features)


class DuelingHead(nnx.Module):
    """A value of the state, and of each action over the mean of all.

        Q(s, a) = V(s) + A(s, a) - mean_b A(s, b)

    (Wang et al. 2016, eq. 9).
    """

    def __init__(self, in_features: int, num_actions: int, *, rngs: nnx.Rngs):
        """Draws parameters."""
        self.value = nnx.Linear(in_features, 1, kernel_init=LAST_KERNEL, rngs=rngs)
        self.advantages = nnx.Linear(
            in_features, num_actions, kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(self, features: Float[Array, " features"]) -> Float[Array, " actions"]:
        """Returns the value of each action given the features of one observation."""
        advantages = self.advantages(features)
        return self.value(features) + advantages - advantages.mean()
