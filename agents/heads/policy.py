"""Turns features into a distribution over the actions that an action spec allows."""

import math

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from ...sim.dynamics.base import ActionSpec, Continuous, Discrete
from ..distributions import SQUASHED_LIMIT, Categorical, TanhMixture
from .initial import LAST_KERNEL

# Before squashing, where the range is about 2: without a floor the density of an action
# repeated exactly (a parked car) grows without end.
MIN_SCALE = 0.01
# Nor may a mean be farther out than the actions whose density is told: those that it
# draws would count as far from it, and a small step as a change beyond all bounds.
MAX_MEAN = math.atanh(SQUASHED_LIMIT)


class CategoricalHead(nnx.Module):
    """A softmax over numbered actions."""

    def __init__(self, in_features: int, spec: Discrete, *, rngs: nnx.Rngs):
        """Draws parameters."""
        self.logits = nnx.Linear(
            in_features, spec.num_actions, kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(self, features: Float[Array, " features"]) -> Categorical:
        """Returns the distribution given the features of one observation."""
        return Categorical(logits=self.logits(features))


class TanhMixtureHead(nnx.Module):
    """A mixture of Gaussians, squashed between the bounds of the actions."""

    def __init__(
        self, in_features: int, spec: Continuous, num_components: int, *, rngs: nnx.Rngs
    ):
        """Draws parameters; the components start apart from each other.

        Raises:
            ValueError: if the bounds of some action feature enclose nothing.
        """
        if not all(low < high for low, high in zip(spec.low, spec.high, strict=True)):
            raise ValueError(
                f"action bounds must have low < high in each feature, got low "
                f"{spec.low} and high {spec.high}"
            )
        self.bounds = spec
        self.num_components = num_components
        num_values = num_components * len(spec.low)
        self.logits = nnx.Linear(
            in_features, num_components, kernel_init=LAST_KERNEL, rngs=rngs
        )
        self.mean = nnx.Linear(
            in_features,
            num_values,
            kernel_init=LAST_KERNEL,
            bias_init=nnx.initializers.normal(0.5),
            rngs=rngs,
        )
        self.raw_scale = nnx.Linear(
            in_features, num_values, kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(self, features: Float[Array, " features"]) -> TanhMixture:
        """Returns the distribution given the features of one observation."""
        shape = (self.num_components, len(self.bounds.low))
        mean = self.mean(features).reshape(shape)
        return TanhMixture(
            logits=self.logits(features),
            mean=MAX_MEAN * jnp.tanh(mean / MAX_MEAN),
            scale=MIN_SCALE + jax.nn.softplus(self.raw_scale(features).reshape(shape)),
            bounds=self.bounds,
        )


def policy_head(
    in_features: int, spec: ActionSpec, num_components: int, *, rngs: nnx.Rngs
) -> CategoricalHead | TanhMixtureHead:
    """Makes the head that fits an action spec.

    Args:
        in_features: how many features the head reads.
        spec: the actions to choose among.
        num_components: of the mixture, where actions are continuous.
        rngs: the source of initial parameters.
    """
    match spec:
        case Discrete():
            return CategoricalHead(in_features, spec, rngs=rngs)
        case Continuous():
            return TanhMixtureHead(in_features, spec, num_components, rngs=rngs)
