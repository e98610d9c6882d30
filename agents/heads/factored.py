"""Turns features into a choice of several numbers at once."""

from flax import nnx
from jaxtyping import Array, Float

from ..factored import FactoredCategorical
from .initial import LAST_KERNEL


class FactoredCategoricalHead(nnx.Module):
    """A softmax for each factor of the actions."""

    def __init__(self, in_features: int, num_bins: tuple[int, ...], *, rngs: nnx.Rngs):
        """Draws parameters.

        Args:
            in_features: how many features the head reads.
            num_bins: of each factor; their product is the number of actions.
            rngs: the source of initial parameters.

        Raises:
            ValueError: if there is no factor, or one without bins.
        """
        if not num_bins or min(num_bins) < 1:
            raise ValueError(
                f"num_bins must be one number of at least 1 per factor, got {num_bins}."
            )
        self.factors = nnx.List(
            [
                nnx.Linear(in_features, count, kernel_init=LAST_KERNEL, rngs=rngs)
                for count in num_bins
            ]
        )

    def __call__(self, features: Float[Array, " features"]) -> FactoredCategorical:
        """Returns the distribution given the features of one observation."""
        return FactoredCategorical(
            logits=tuple(factor(features) for factor in self.factors)
        )
