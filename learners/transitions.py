"""Cuts the steps of an unroll into transitions, each to be learned from alone."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..sim.dynamics.base import Action
from ..sim.observations.base import Observation
from ..sim.records import Record
from .acting import Step


class Transition(Record):
    """What an actor saw and did, what it got for it, and what it saw n steps later."""

    observation_t: Observation
    action_t: Action
    return_t: Float[Array, ""]  # of the n steps, discounted to the first
    discount_tpn: Float[Array, ""]  # of the value of what was seen last
    observation_tpn: Observation


def transitions(
    steps: Step, last: Observation, num_steps: int, discount: float
) -> tuple[Transition, Bool[Array, " starts"]]:
    """Returns the transitions of a world with one actor that are known to their end.

    Those are of all steps but the last n - 1. With the environment's own discounts d, 0
    where the task ended, and g of the learner (Sutton and Barto 2018, eq. 7.1):

        return_t     = sum_k g^k (d_t ... d_{t+k-1}) r_{t+k},    0 <= k < n
        discount_tpn = g^n d_t ... d_{t+n-1}

    n is smaller where the episode ends before. Where an episode is cut, what follows is
    worth what its true last observation says: that is of the step after, which is no
    transition itself.

    Args:
        steps: in their order, at least n.
        last: what is seen after them.
        num_steps: n, at least 1.
        discount: g.

    Returns:
        The transitions, and whether each is one: those of steps without mask are not.
    """
    starts = len(steps.mask) - num_steps + 1
    seen = jax.tree.map(
        lambda leaf, end: jnp.concatenate([leaf, end[None]]), steps.observation, last
    )

    def reach(t: Array) -> tuple[Array, Array, Array]:
        """Returns return and discount of a transition, and the step it leads to."""
        return_t, discount_tpn, end = jnp.float32(0.0), jnp.float32(1.0), t
        goes_on = jnp.bool_(True)
        for now in t + jnp.arange(num_steps):
            return_t += jnp.where(goes_on, discount_tpn * steps.reward[now], 0.0)
            following = discount_tpn * discount * steps.discount[now]
            discount_tpn = jnp.where(goes_on, following, discount_tpn)
            end += goes_on
            goes_on &= ~steps.ended[now]
        return return_t, discount_tpn, end

    return_t, discount_tpn, end = jax.vmap(reach)(jnp.arange(starts))
    observation_t, action_t, mask = jax.tree.map(
        lambda leaf: leaf[:starts], (steps.observation, steps.action, steps.mask)
    )
    cut = Transition(
        observation_t=observation_t,
        action_t=action_t,
        return_t=return_t,
        discount_tpn=discount_tpn,
        observation_tpn=jax.tree.map(lambda leaf: leaf[end], seen),
    )
    return cut, mask
