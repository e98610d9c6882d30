"""Turns the tokens of an encoder into a forecast of several trajectories."""

import dataclasses

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, Float

from ...sim import ranges
from ..encoders.attention import AttentionBlock
from ..trajectories import Trajectories
from .initial import LAST_KERNEL

# A standard deviation [m, rad] below which no step is held to be known: without a floor
# the density of a car that stays parked grows without end.
MIN_SCALE = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrajectoryConfig:
    """How many trajectories there are, and how long."""

    num_modes: int = 64
    num_steps: int = 80
    num_layers: int = 2  # of attention from modes to tokens, and among modes
    num_heads: int = 4  # of attention
    mlp_ratio: int = 2  # width of a layer's perceptron over its own

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a size is below 1.
        """
        ranges.require_at_least(self, **dict.fromkeys(dataclasses.asdict(self), 1))


class TrajectoryHead(nnx.Module):
    """Learned queries, one a mode, that attend to what an encoder has found.

    Each layer lets every mode gather from the tokens, then from the other modes
    (Nayakanti et al. 2022, section 3). Of a mode's embedding one output is its logit,
    the others are mean and scale of all its steps. The mean is a sum of steps:

        mean_t = sum of outputs up to t,    scale_t = floor + softplus(output_t)

    Departs from the paper in that sum: with it small outputs, as there are at first,
    make smooth trajectories. Modes start apart, as their queries are random.
    """

    def __init__(self, width: int, config: TrajectoryConfig, *, rngs: nnx.Rngs):
        """Draws parameters for tokens of a width.

        Raises:
            ValueError: if the attention heads do not divide the width.
        """
        if width % config.num_heads:
            raise ValueError(
                f"num_heads must divide width, got {config.num_heads} heads for a "
                f"width of {width}."
            )

        def blocks() -> list[AttentionBlock]:
            return [
                AttentionBlock(width, config.num_heads, config.mlp_ratio, rngs=rngs)
                for _ in range(config.num_layers)
            ]

        self.shape = (config.num_modes, config.num_steps, 3)
        self.modes = nnx.Embed(config.num_modes, width, rngs=rngs)
        self.cross, self.among = nnx.List(blocks()), nnx.List(blocks())
        self.norm = nnx.LayerNorm(width, rngs=rngs)
        num_values = config.num_steps * 3
        # No bias: it would shift all logits alike, which their softmax does not see.
        self.logit = nnx.Linear(
            width, 1, use_bias=False, kernel_init=LAST_KERNEL, rngs=rngs
        )
        self.step = nnx.Linear(width, num_values, kernel_init=LAST_KERNEL, rngs=rngs)
        self.raw_scale = nnx.Linear(
            width, num_values, kernel_init=LAST_KERNEL, rngs=rngs
        )

    def __call__(
        self, tokens: Float[Array, "tokens width"], mask: Bool[Array, " tokens"]
    ) -> Trajectories:
        """Returns the forecast given the tokens of one observation."""
        modes = self.modes.embedding[...]
        every_mode = jnp.ones(modes.shape[0], bool)
        for cross, among in zip(self.cross, self.among, strict=True):
            modes = cross(modes, tokens, mask)
            modes = among(modes, modes, every_mode)
        modes = self.norm(modes)

        raw_scale = self.raw_scale(modes).reshape(self.shape)
        return Trajectories(
            logits=self.logit(modes)[:, 0],
            mean=jnp.cumsum(self.step(modes).reshape(self.shape), axis=1),
            scale=MIN_SCALE + jax.nn.softplus(raw_scale),
        )
