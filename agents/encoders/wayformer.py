"""Encodes an observation as a member of the Wayformer family does."""

import dataclasses
from typing import Literal

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, Float

from ...sim import names, ranges
from ...sim.observations.base import Observation
from .attention import AttentionBlock
from .fusion import FUSIONS, check_steps, side_by_side, split_depth
from .scene_attention import ATTENTIONS, SceneAttention, attended_axes, flat
from .tokens import TokenEmbedding

DTYPES = ("float32", "bfloat16")


@dataclasses.dataclass(frozen=True, kw_only=True)
class WayformerConfig:
    """The kind of encoder and its size."""

    name: Literal["wayformer"] = "wayformer"
    width: int = 64
    num_heads: int = 4
    num_layers: int = 2  # of self-attention on the way from a token to the output
    num_latents: int = 8  # at most, of each encoder that meets tokens; 0 for none
    mlp_ratio: int = 2  # width of a block's perceptron over the width of the encoder
    fusion: str = "early"  # one of FUSIONS
    attention: str = "multi_axis"  # one of ATTENTIONS
    positions: bool = False  # tell the tokens of a group apart by their number
    dtype: str = "float32"  # of products of matrices; the rest is float32

    def __post_init__(self) -> None:
        """Checks names and ranges.

        Raises:
            ValueError: if a name is unknown, a size is too small, or sizes do not fit
                each other.
        """
        for field, known in (
            ("fusion", FUSIONS),
            ("attention", ATTENTIONS),
            ("dtype", DTYPES),
        ):
            if getattr(self, field) not in known:
                raise names.unknown(field, getattr(self, field), known)
        ranges.require_at_least(self, width=1, num_heads=1, num_layers=1, mlp_ratio=1)
        ranges.require_at_least(self, num_latents=0)
        if self.width % self.num_heads:
            raise ValueError(
                f"num_heads must divide width, got {self.num_heads} heads for a width "
                f"of {self.width}."
            )
        parts = (1 + (self.fusion == "hierarchical")) * (
            1 + (self.attention != "multi_axis")
        )
        if self.num_layers % parts:
            raise ValueError(
                f"num_layers must be a multiple of {parts} for {self.fusion} fusion "
                f"with {self.attention} attention, got {self.num_layers}."
            )


class Wayformer(SceneAttention):
    """Attention among the groups of an observation (Nayakanti et al. 2022, section 3).

        early          all groups  ->  joint encoder
        late           each group  ->  its own encoder  ->  side by side
        hierarchical   each group  ->  its own encoder  ->  joint encoder

    The joint encoder is this module itself, so that parameters of early fusion lie
    where they always did. The first encoder that tokens meet has the latents, if any;
    the paper fits their number to the input's length, here a group of fewer tokens has
    as many latents as tokens. Factorized attention repeats groups of one step along
    time before they meet others.

    Departs from the paper: no activation after the projections, no embedding of a
    token's number by default (see `GroupEmbedding`), norms before the layers.
    """

    def __init__(
        self, config: WayformerConfig, observation: Observation, *, rngs: nnx.Rngs
    ):
        """Draws parameters for observations of this one's groups and shapes.

        Raises:
            ValueError: if attention is factorized and steps of groups do not match.
        """
        self.is_flat = config.attention == "multi_axis"
        self.is_late = config.fusion == "late"
        width, dtype = config.width, jnp.dtype(config.dtype)
        own_depth, joint_depth = split_depth(config.fusion, config.num_layers)
        shapes = {
            name: (group.mask.size, 1) if self.is_flat else group.mask.shape
            for name, group in sorted(observation.items())
        }
        num_steps = max(steps for _, steps in shapes.values())
        if not self.is_late:
            check_steps({name: steps for name, (_, steps) in shapes.items()})

        def block() -> AttentionBlock:
            return AttentionBlock(
                width, config.num_heads, config.mlp_ratio, dtype=dtype, rngs=rngs
            )

        def latents(count: int) -> nnx.Embed | None:
            return nnx.Embed(count, width, rngs=rngs) if count else None

        self.tokens = TokenEmbedding(
            observation, width, positions=config.positions, dtype=dtype, rngs=rngs
        )
        own = {}
        for name, (num_tokens, steps) in shapes.items() if own_depth else ():
            axes = attended_axes(config.attention, own_depth, steps)
            count = min(config.num_latents, num_tokens)
            own[name] = SceneAttention(axes, latents(count), block)
        self.own = nnx.Dict(own) if own else None
        super().__init__(
            attended_axes(config.attention, joint_depth, num_steps),
            None if own_depth else latents(config.num_latents),
            block,
        )
        self.norm = nnx.LayerNorm(width, rngs=rngs)

    def encode(
        self, observation: Observation
    ) -> tuple[Float[Array, "tokens width"], Bool[Array, " tokens"]]:
        """Returns what a decoder may attend to: latents or tokens, and their mask."""
        groups = self.tokens(observation)
        if self.is_flat:
            groups = {name: flat(tokens) for name, tokens in groups.items()}
        if self.own is not None:
            groups = {name: self.own[name].attend(groups[name]) for name in groups}
        if self.is_late:
            groups = {name: flat(tokens) for name, tokens in groups.items()}

        scene = flat(self.attend(side_by_side(list(groups.values()))))
        values, mask = self.norm(scene.values[:, 0]), scene.mask[:, 0]
        return jnp.where(mask[:, None], values, 0.0), mask

    def __call__(self, observation: Observation) -> Float[Array, " width"]:
        """Encodes one observation: the mean of what is present, zero if nothing is."""
        values, mask = self.encode(observation)
        return values.sum(axis=0) / jnp.maximum(mask.sum(), 1)
