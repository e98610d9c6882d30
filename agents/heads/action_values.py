"""Turns features into the values of numbered actions.

An action may be several numbers in one, as in discrete dynamics, the first the slowest:
told apart, what is learned of one number is known wherever it is chosen.
"""

import functools
import itertools

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from .initial import LAST_KERNEL


class ActionValueHead(nnx.Module):
    """An output for each action, or the sum of one for each of its numbers.

    Q(s, a) = sum_i Q_i(s, a_i),    a = (a_1 n_2 + a_2) n_3 + ...
    """

    def __init__(self, in_features: int, bins: tuple[int, ...], *, rngs: nnx.Rngs):
        """Draws parameters.

        Args:
            in_features: how many features the head reads.
            bins: n_i, of how many values each number is; one for actions as a whole.
            rngs: the source of initial parameters.
        """
        self.bins = bins
        self.values = nnx.Linear(
            in_features, sum(bins), kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(self, features: Float[Array, " features"]) -> Float[Array, " actions"]:
        """Returns the value of each action given the features of one observation."""
        return _summed(_parts(self.values(features), self.bins))


class DuelingHead(nnx.Module):
    """A value of the state, and of each action over the mean of all.

        Q(s, a) = V(s) + A(s, a) - mean_b A(s, b)

    (Wang et al. 2016, eq. 9), where A is a sum over numbers as in `ActionValueHead`
    (compare the branches of Tavakoli et al. 2018, eq. 1, which are not summed).
    """

    def __init__(self, in_features: int, bins: tuple[int, ...], *, rngs: nnx.Rngs):
        """Draws parameters; the arguments are those of `ActionValueHead`."""
        self.bins = bins
        self.value = nnx.Linear(in_features, 1, kernel_init=LAST_KERNEL, rngs=rngs)
        self.advantages = nnx.Linear(
            in_features, sum(bins), kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(self, features: Float[Array, " features"]) -> Float[Array, " actions"]:
        """Returns the value of each action given the features of one observation."""
        advantages = _summed(_parts(self.advantages(features), self.bins))
        return self.value(features) + advantages - advantages.mean()


def _parts(
    outputs: Float[Array, " outputs"], bins: tuple[int, ...]
) -> list[Float[Array, " _"]]:
    """Returns the outputs of each number."""
    ends = list(itertools.accumulate(bins))
    return jnp.split(outputs, ends[:-1])


def _summed(parts: list[Float[Array, " _"]]) -> Float[Array, " actions"]:
    """Returns the sum of the parts of each action."""

    def join(
        slower: Float[Array, " m"], faster: Float[Array, " n"]
    ) -> Float[Array, " mn"]:
        return (slower[:, None] + faster[None]).reshape(-1)

    return functools.reduce(join, parts)
