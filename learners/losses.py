"""Measures how far a policy is from what it should do."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..agents.distributions import ActionValues, Categorical, Distribution, TanhMixture
from ..agents.factored import FactoredCategorical
from ..sim.dynamics.base import Action
from .base import Mean


def weighted(values: Float[Array, "*batch"], weights: Float[Array, "*batch"]) -> Mean:
    """Means values by weight; a value of weight zero may be anything, NaN included."""
    return Mean(
        total=jnp.sum(jnp.where(weights > 0, values, 0.0) * weights),
        weight=jnp.sum(weights),
    )


def combine(terms: Sequence[tuple[float, Mean]], axis_name: str) -> Mean:
    """Adds means over all devices, each by its factor, as the share of this device.

    Each may have weights of its own, which must not depend on what is learned.
    """
    total = jnp.float32(0.0)
    for factor, mean in terms:
        weight = jax.lax.psum(mean.weight, axis_name)
        total += factor * mean.total / jnp.where(weight > 0, weight, 1.0)
    return Mean(total=total, weight=jnp.float32(1 / jax.lax.axis_size(axis_name)))


def imitation_error(
    policy: Distribution | ActionValues, action: Action
) -> dict[str, Float[Array, ""]]:
    """Compares the action that a policy would drive with the expert's.

    Returns:
        `accuracy`, whether the two are the same, for numbered actions; else
        `absolute_error`, averaged over the features as fractions of their ranges, since
        their units differ.
    """
    mode = policy.mode()
    match policy:
        case Categorical() | FactoredCategorical() | ActionValues():
            return {"accuracy": (mode == action).astype(jnp.float32)}
        case TanhMixture(bounds=bounds):
            span = jnp.array(bounds.high) - jnp.array(bounds.low)
            return {"absolute_error": jnp.mean(jnp.abs(mode - action) / span)}


def surprise(policy: Distribution | ActionValues, action: Action) -> Float[Array, ""]:
    """Returns how unlikely an action is, -log p(a) [nats].

    Values of actions are no distribution; theirs counts as softmax over them.
    """
    if isinstance(policy, ActionValues):
        return -Categorical(logits=policy.values).log_prob(action)
    return -policy.log_prob(action)
