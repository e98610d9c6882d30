"""Attends from a set of queries to a set of tokens under a mask."""

import jax
import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, Float


class Attention(nnx.Module):
    """Scaled dot-product attention with several heads (Vaswani et al. 2017, eq. 1).

        out_q = sum_h O_h V_h sum_t softmax_t(x_q . Q_h' K_h c_t / sqrt(d)) c_t + b

    over the tokens t that are present. Where none is, the sum over t is zero.

    Few queries meet many tokens here, so K_h is applied to the queries and V_h to the
    sums, never to the tokens: the same numbers in 0.6 of the time for 8 queries and 355
    tokens (gradient of a batch of 64 on two CPU cores).
    """

    def __init__(self, width: int, num_heads: int, *, rngs: nnx.Rngs):
        """Draws parameters; `num_heads` divides `width`."""
        self.num_heads = num_heads
        self.query = nnx.Linear(width, width, rngs=rngs)
        self.key = nnx.Linear(width, width, use_bias=False, rngs=rngs)
        self.value = nnx.Linear(width, width, use_bias=False, rngs=rngs)
        self.out = nnx.Linear(width, width, rngs=rngs)

    def __call__(
        self,
        queries: Float[Array, "queries width"],
        tokens: Float[Array, "tokens width"],
        mask: Bool[Array, " tokens"],
    ) -> Float[Array, "queries width"]:
        """Returns what each query gathers from the tokens that are present."""
        num_queries, width = queries.shape
        by_head = (-1, self.num_heads, width // self.num_heads)
        key_kernel = self.key.kernel[...].reshape(by_head)
        value_kernel = self.value.kernel[...].reshape(by_head)

        query = self.query(queries).reshape(by_head) / jnp.sqrt(by_head[-1])
        probes = jnp.einsum("qhd,whd->hqw", query, key_kernel).reshape(-1, width)
        gathered = _gather(probes, tokens, mask).reshape(-1, num_queries, width)
        values = jnp.einsum("hqw,whd->qhd", gathered, value_kernel)
        return self.out(values.reshape(queries.shape))


def _gather(
    probes: Float[Array, "probes width"],
    tokens: Float[Array, "tokens width"],
    mask: Bool[Array, " tokens"],
) -> Float[Array, "probes width"]:
    present = mask[:, None]
    scores = jnp.where(present, tokens @ probes.T, -jnp.inf)
    highest = jnp.where(mask.any(), scores.max(axis=0, initial=-jnp.inf), 0.0)
    # The highest score only keeps exp in range: the quotient does not depend on it.
    weights = jnp.exp(scores - jax.lax.stop_gradient(highest)[None])
    total = jnp.where(mask.any(), weights.sum(axis=0), 1.0)
    return weights.T @ tokens / total[:, None]


class AttentionBlock(nnx.Module):
    """Attention, then a perceptron, each behind a norm and beside a shortcut."""

    def __init__(self, width: int, num_heads: int, mlp_ratio: int, *, rngs: nnx.Rngs):
        """Draws parameters; the perceptron is `mlp_ratio` times as wide inside."""
        self.query_norm = nnx.LayerNorm(width, rngs=rngs)
        self.token_norm = nnx.LayerNorm(width, rngs=rngs)
        self.attention = Attention(width, num_heads, rngs=rngs)
        self.mlp_norm = nnx.LayerNorm(width, rngs=rngs)
        self.expand = nnx.Linear(width, mlp_ratio * width, rngs=rngs)
        self.contract = nnx.Linear(mlp_ratio * width, width, rngs=rngs)

    def __call__(
        self,
        queries: Float[Array, "queries width"],
        tokens: Float[Array, "tokens width"],
        mask: Bool[Array, " tokens"],
    ) -> Float[Array, "queries width"]:
        """Returns the queries, changed by the tokens that are present."""
        normed = self.query_norm(queries)
        queries = queries + self.attention(normed, self.token_norm(tokens), mask)
        hidden = jax.nn.gelu(self.expand(self.mlp_norm(queries)))
        return queries + self.contract(hidden)
