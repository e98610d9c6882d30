"""Encodes an observation as Wayformer does with early fusion."""

import dataclasses

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from ...sim.observations.base import Observation
from .attention import AttentionBlock
from .tokens import TokenEmbedding


@dataclasses.dataclass(frozen=True, kw_only=True)
class WayformerConfig:
    """The size of the encoder."""

    width: int = 64
    num_heads: int = 4
    num_layers: int = 2  # of self-attention among the latents
    num_latents: int = 8
    mlp_ratio: int = 2  # width of a block's perceptron over the width of the encoder


class Wayformer(nnx.Module):
    """Early fusion with latent queries (Nayakanti et al. 2022, section 3).

    All (token, step) pairs of all groups form one sequence. Learned latents gather from
    it once by cross-attention, then attend to each other; their mean is the embedding.
    """

    def __init__(
        self, config: WayformerConfig, observation: Observation, *, rngs: nnx.Rngs
    ):
        """Draws parameters for observations of this one's groups and shapes."""
        width = config.width
        self.tokens = TokenEmbedding(observation, width, rngs=rngs)
        self.latents = nnx.Embed(config.num_latents, width, rngs=rngs)
        self.cross = self._block(config, rngs)
        self.blocks = nnx.List(
            [self._block(config, rngs) for _ in range(config.num_layers)]
        )
        self.norm = nnx.LayerNorm(width, rngs=rngs)

    def __call__(self, observation: Observation) -> Float[Array, " width"]:
        """Encodes one observation."""
        tokens, mask = self.tokens(observation)
        latents = self.cross(self.latents.embedding[...], tokens, mask)
        every_latent = jnp.ones(latents.shape[0], bool)
        for block in self.blocks:
            latents = block(latents, latents, every_latent)
        return self.norm(latents).mean(axis=0)

    def _block(self, config: WayformerConfig, rngs: nnx.Rngs) -> AttentionBlock:
        return AttentionBlock(
            config.width, config.num_heads, config.mlp_ratio, rngs=rngs
        )
