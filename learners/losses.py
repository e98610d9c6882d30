"""Measures how far a policy is from what it should do."""

from collections.abc import Sequence

import jax
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
    policy: Distribution | ActionValues | Planned,
    action: Action,
    smoothing: float = 0.0,
) -> Float[Array, ""]:
    """Returns how unlikely an action is [nats].

        -(1 - e) log p(a) - e / N sum_b log p(b)

    with label smoothing e (Szegedy et al. 2016, section 7) over N numbered actions.
    Values of actions are no distribution; theirs counts as softmax over them.

    Args:
        policy: which should have taken the action.
        action: what the expert did.
        smoothing: e, from 0 to 1.

    Raises:
        ValueError: while it is traced, if continuous actions are to be smoothed.
        TypeError: if the policy is a plan, which takes its action for sure.
    """
    if isinstance(policy, Planned):
        raise _planned()
    if isinstance(policy, ActionValues):
        policy = Categorical(logits=policy.values)
    likely = policy.log_prob(action)
    if not smoothing:
        return -likely
    match policy:
        case Categorical(logits=logits):
            mean = jax.nn.log_softmax(logits).mean()
        case FactoredCategorical(logits=factors):
            means = [jax.nn.log_softmax(logits).mean() for logits in factors]
            mean = jnp.sum(jnp.stack(means))
        case TanhMixture():
            raise ValueError(
                "label_smoothing needs numbered actions, such as those of "
                "dynamics=bicycle_discrete"
            )
    return -(1 - smoothing) * likely - smoothing * mean


def _planned() -> TypeError:
    return TypeError("a plan is no distribution over actions; train its forecasts.")
