"""Attends among the tokens of a scene along one axis of their grid after the other."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Float

from .attention import AttentionBlock
from .tokens import Tokens

ATTENTIONS = ("multi_axis", "factorized_sequential", "factorized_interleaved")


def attended_axes(attention: str, num_layers: int, num_steps: int) -> tuple[str, ...]:
    """Says along which axis each layer attends (Nayakanti et al. 2022, section 3).

    Multi-axis attention sees the whole scene as tokens of one step (`flat`). Factorized
    attention spends half of its layers on time, either all before those on space or in
    turns, time first. A scene of one step has the spatial half alone.

    Args:
        attention: one of `ATTENTIONS`.
        num_layers: even where attention is factorized.
        num_steps: of the scene.

    Returns:
        For each layer, `steps` or `tokens`.
    """
    half = num_layers // 2
    axes = {
        "multi_axis": ("tokens",) * num_layers,
        "factorized_sequential": ("steps",) * half + ("tokens",) * half,
        "factorized_interleaved": ("steps", "tokens") * half,
    }[attention]
    if num_steps == 1:
        return tuple(axis for axis in axes if axis == "tokens")
    return axes


def flat(tokens: Tokens) -> Tokens:
    """Returns every (token, step) pair as a token of one step, steps running faster."""
    return Tokens(
        values=tokens.values.reshape(-1, 1, tokens.values.shape[-1]),
        mask=tokens.mask.reshape(-1, 1),
    )


class SceneAttention(nnx.Module):
    """Layers of self-attention, behind learned latents or not.

    Latents, if there are, gather from the tokens of each step by cross-attention, and
    take their place. They stand for tokens and not for steps since of these there are
    few. All latents are present: those that find no token say so.
    """

    def __init__(
        self,
        axes: tuple[str, ...],
        latents: nnx.Embed | None,
        block: Callable[[], AttentionBlock],
    ):
        """Draws parameters.

        Args:
            axes: along which each layer of self-attention attends.
            latents: the learned queries of the first layer.
            block: makes a layer.
        """
        self.axes = axes
        self.latents = latents
        self.cross = block() if latents is not None else None
        self.blocks = nnx.List([block() for _ in axes])

    def attend(self, tokens: Tokens) -> Tokens:
        """Lets the tokens that are present, or the latents, take note of each other."""
        if self.latents is not None and self.cross is not None:
            num_steps = tokens.mask.shape[1]
            latents = self.latents.embedding[...]
            queries = jnp.broadcast_to(
                latents[:, None], (latents.shape[0], num_steps, latents.shape[1])
            )
            values = _attend_along("tokens", self.cross, queries, tokens)
            tokens = Tokens(values=values, mask=jnp.ones(values.shape[:2], bool))

        for axis, block in zip(self.axes, self.blocks, strict=True):
            values = _attend_along(axis, block, tokens.values, tokens)
            tokens = tokens.replace(values=values)
        return tokens


def _attend_along(
    axis: str,
    block: AttentionBlock,
    queries: Float[Array, "queries steps width"],
    tokens: Tokens,
) -> Float[Array, "queries steps width"]:
    """Applies a block along one axis, to each place on the other by itself."""
    if axis == "steps":
        return jax.vmap(block)(queries, tokens.values, tokens.mask)
    if tokens.mask.shape[1] == 1:
        return block(queries[:, 0], tokens.values[:, 0], tokens.mask[:, 0])[:, None]
    return jax.vmap(block, in_axes=1, out_axes=1)(queries, tokens.values, tokens.mask)
