"""Measures how far a policy is from what it should do."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..agents.distributions import ActionValues, Categorical, Distribution, TanhMixture
from ..agents.factored import FactoredCategorical
from ..agents.plan import Planned
from ..sim.dynamics.base import Action
from .base import Mean


def weighted(values: Float[Array, "*batch"], weights: Float[Array, "*batch"]) -> Mean:
    """Means values by weight; a value of weight zero may be anything, NaN included."""
    return Mean(
        total=jnp.sum(jnp.where(weights > 0, values, 0.0) * weights),
        weight=jnp.sum(weights),
    )


def imitation_error(
    policy: Distribution | ActionValues | Planned, action: Action
) -> dict[str, Float[Array, ""]]:
    """Compares the action that a policy would drive with the expert's.

    Returns:
        `accuracy`, whether the two are the same, for numbered actions; else
        `absolute_error`, averaged over the features as fractions of their ranges, since
        their units differ.

    Raises:
        TypeError: if the policy is a plan, whose actions have no range.
    """
    mode = policy.mode()
    match policy:
        case Categorical() | FactoredCategorical() | ActionValues():
            return {"accuracy": (mode == action).astype(jnp.float32)}
        case TanhMixture(bounds=bounds):
            span = jnp.array(bounds.high) - jnp.array(bounds.low)
            return {"absolute_error": jnp.mean(jnp.abs(mode - action) / span)}
        case Planned():
            raise _planned()


def surprise(
    policy: Distribution | ActionValues | Planned, action: Action
) -> Float[Array, ""]:
    """Returns how unlikely an action is, -log p(a) [nats].

    Values of actions are no distribution; theirs counts as softmax over them.

    Raises:
        TypeError: if the policy is a plan, which takes its action for sure.
    """
    match policy:
        case ActionValues(values=values):
            return -Categorical(logits=values).log_prob(action)
        case Planned():
            raise _planned()
        case _:
            return -policy.log_prob(action)


def _planned() -> TypeError:
    return TypeError("a plan is no distribution over actions; train its forecasts.")
