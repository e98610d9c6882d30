"""Encodes an observation by plain layers over all its numbers in one row."""

import dataclasses
import itertools
import math
from typing import Literal

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from ...sim import names
from ...sim.observations.base import Observation

ACTIVATIONS = {"tanh": jnp.tanh, "relu": jax.nn.relu}


@dataclasses.dataclass(frozen=True, kw_only=True)
class FlatConfig:
    """The size of the encoder; Nocturne's imitation has relu and (1025, 256, 128)."""

    name: Literal["flat"] = "flat"
    widths: tuple[int, ...] = (256, 256)  # of the layers
    activation: str = "tanh"
    scale: float = 10.0  # observations are divided by it

    def __post_init__(self) -> None:
        """Checks names and ranges.

        Raises:
            ValueError: if a layer has no width, the scale is not positive or the
                activation is unknown.
        """
        if self.activation not in ACTIVATIONS:
            raise names.unknown("activation", self.activation, ACTIVATIONS)
        if not self.widths or min(self.widths) < 1:
            raise ValueError(
                f"widths must be one number of at least 1 per layer, got {self.widths}."
            )
        if not 0 < self.scale < math.inf:
            raise ValueError(f"scale must be a positive number, got {self.scale}.")


class FlatEncoder(nnx.Module):
    """A perceptron over an observation laid out in one row (Vinitsky et al. 2022, A.1).

        x_0 = values / scale,  x_l = activation(W_l x_{l-1} + b_l)

    The row holds the values of each group, absent ones as zeros, and behind them its
    mask, not divided: without it a thing at the origin and none would look the same.
    """

    def __init__(self, config: FlatConfig, observation: Observation, *, rngs: nnx.Rngs):
        """Draws parameters for observations of this one's groups and shapes."""
        self.scale = config.scale
        self.activation = config.activation
        num_features = sum(
            group.values.size + group.mask.size for group in observation.values()
        )
        sizes = (num_features, *config.widths)
        self.layers = nnx.List(
            [
                nnx.Linear(size, width, rngs=rngs)
                for size, width in itertools.pairwise(sizes)
            ]
        )

    def __call__(self, observation: Observation) -> Float[Array, " width"]:
        """Encodes one observation."""
        activate = ACTIVATIONS[self.activation]
        x = self._row(observation)
        for layer in self.layers:
            x = activate(layer(x))
        return x

    def _row(self, observation: Observation) -> Float[Array, " features"]:
        parts = []
        for _, group in sorted(observation.items()):
            present = jnp.where(group.mask[..., None], group.values, 0.0)
            parts += [present.ravel() / self.scale, group.mask.ravel().astype(float)]
        return jnp.concatenate(parts)
