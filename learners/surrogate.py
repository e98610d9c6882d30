"""States the objective of proximal policy optimization."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def clipped(
    log_ratio: Float[Array, "*batch"], advantage: Float[Array, "*batch"], clip: float
) -> Float[Array, "*batch"]:
    """Returns what is gained by a change of probability, as far as it is believed.

    With r the ratio of new to old (Schulman et al. 2017, equation 7):

        min(r A, clip(r, 1 - e, 1 + e) A)
    """
    ratio = jnp.exp(log_ratio)
    believed = jnp.clip(ratio, 1 - clip, 1 + clip)
    return jnp.minimum(ratio * advantage, believed * advantage)


def is_clipped(log_ratio: Float[Array, "*batch"], clip: float) -> Bool[Array, "*batch"]:
    """Tells whether a ratio is out of the range in which it is believed."""
    return jnp.abs(jnp.expm1(log_ratio)) > clip


def divergence(log_ratio: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Returns estimates of KL(old, new) [nats], never negative and without bias.

    With r the ratio of new to old at actions of the old: (r - 1) - log r (Schulman
    2020, "Approximating KL divergence", k3).
    """
    return jnp.expm1(log_ratio) - log_ratio
