"""Measures how wrong the values of actions are."""

import jax
import jax.numpy as jnp
import rlax
from jaxtyping import Array, Float, Int

from ..agents.base import Agent, Params
from ..agents.distributions import ActionValues
from ..sim.env.demonstrations import Demonstration
from ..sim.observations.base import Observation
from . import losses
from .base import Mean, Metrics
from .transitions import Transition


def action_values(
    agent: Agent, params: Params, observation: Observation
) -> Float[Array, " actions"]:
    """Returns what each action is worth by an agent without memory.

    Raises:
        TypeError: while it is traced, if the agent's policy is another.
    """
    _, output = agent.step(params, agent.memory(), observation)
    if not isinstance(output.policy, ActionValues):
        raise TypeError(
            f"an agent that learns the values of actions must return ActionValues, got "
            f"{type(output.policy).__name__}."
        )
    return output.policy.values


def td_error(
    agent: Agent, params: Params, target: Params, transition: Transition
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Returns the error of a transition by double Q-learning, and the action's value.

    With the return R of n steps, their discount D and the parameters p of the agent and
    p- of the target (van Hasselt, Guez and Silver 2016, eq. 4)

        error = R + D Q(o_{t+n}, argmax_a Q(o_{t+n}, a; p); p-) - Q(o_t, a_t; p)

    where the gradient is of the last term only.
    """
    value_t = action_values(agent, params, transition.observation_t)
    error = rlax.double_q_learning(
        value_t,
        transition.action_t,
        transition.return_t,
        transition.discount_tpn,
        action_values(agent, target, transition.observation_tpn),
        action_values(agent, params, transition.observation_tpn),
    )
    return jnp.asarray(error), value_t[transition.action_t]


def means(
    weights: Float[Array, "*batch"],
    errors: Float[Array, "*batch"],
    values: Float[Array, "*batch"],
    huber: float | None = None,
) -> Metrics:
    """Returns the loss of a batch, and what tells of it.

    With the importance weights w and the errors d, down whose gradient are the steps
    along w d grad Q of Schaul et al. 2016 (algorithm 1):

        loss = mean of w d^2 / 2

    or, where |d| exceeds a limit h, w h (|d| - h / 2) in place of w d^2 / 2, by which
    the steps grow no more (Huber 1964; as Mnih et al. 2015 clip errors).

    Args:
        weights: zero for what does not count.
        errors: of each transition.
        values: likewise, of its action.
        huber: h; None for squares of all errors.
    """
    is_drawn = weights > 0
    loss = rlax.l2_loss(errors) if huber is None else rlax.huber_loss(errors, huber)
    terms = {
        "loss": weights * loss,
        "td_error": jnp.abs(errors),
        "value": values,
    }
    count = is_drawn.astype(jnp.float32)
    return {name: losses.weighted(term, count) for name, term in terms.items()}


def expert_margin(
    values: Float[Array, " actions"], action: Int[Array, ""], margin: float
) -> Float[Array, ""]:
    """Returns by how much an expert's action fails to be the best by a margin.

    With the expert's action e and l(e, a) the margin, but 0 where a is e (Hester et al.
    2018, eq. 3)

        max_a [Q(o, a) + l(e, a)] - Q(o, e)
    """
    is_other = jnp.arange(len(values)) != action
    return jnp.max(values + margin * is_other) - values[action]


def imitation(
    agent: Agent, params: Params, batch: Demonstration, margin: float
) -> Mean:
    """Returns the mean of `expert_margin` over demonstrations, by their weight."""

    def imitate(shown: Demonstration) -> Float[Array, ""]:
        values = action_values(agent, params, shown.observation)
        return expert_margin(values, shown.action, margin)

    return losses.weighted(jax.vmap(imitate)(batch), batch.weight)
