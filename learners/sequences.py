"""Cuts what actors did into sequences to learn from, and goes through them again."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray, PyTree

from ..agents.base import Agent, Memory, Output, Params
from ..agents.distributions import ActionValues, Distribution
from ..agents.plan import Planned
from ..sim import pytrees
from ..sim.dynamics.base import Action
from ..sim.observations.base import Observation
from ..sim.records import Record
from . import strata
from .stage import Played


class Note(Record):
    """What a learner by sequences remembers of a choice."""

    log_prob: Float[Array, ""]
    value: Float[Array, ""]


class Sequence(Record):
    """What one actor did in a row."""

    memory: Memory  # before the first step
    observation: Observation
    action: Action
    note: Note
    reward: Float[Array, " steps"]
    discount: Float[Array, " steps"]
    mask: Bool[Array, " steps"]  # where False, it did not act, and remembers nothing


def explore(output: Output, key: PRNGKeyArray) -> tuple[Action, Note]:
    """Draws an action, and notes how likely it was."""
    policy = distribution(output)
    action = policy.sample(key)
    return action, Note(log_prob=policy.log_prob(action), value=output.value)


def distribution(output: Output) -> Distribution:
    """Returns the policy of an agent that draws its actions.

    Raises:
        TypeError: while it is traced, if the agent values actions or plans instead.
    """
    if isinstance(output.policy, ActionValues | Planned):
        raise TypeError("the agent must draw its actions, not value or plan them.")
    return output.policy


def of_actors(played: Played) -> Sequence:
    """Returns what each actor did, [worlds, *actors, ...]."""
    steps, num_actors = played.steps, played.steps.mask.ndim - 2
    found = Sequence(
        memory=(),
        observation=steps.observation,
        action=steps.action,
        note=steps.note,
        reward=steps.reward,
        discount=steps.discount,
        mask=steps.mask,
    )
    rows = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1 + num_actors), found)
    return rows.replace(memory=played.before.memory)


def recall(
    agent: Agent, params: Params, sequence: Sequence
) -> tuple[Output, Float[Array, " steps"]]:
    """Goes through a sequence again, with memory as it was kept when acting.

    Returns:
        What the agent makes of each step, and the logarithm of the ratio of the
        action's probability to what it was; 0 where the mask is False.
    """

    def look(memory: Memory, seen: tuple[Observation, Array]) -> tuple[Memory, Output]:
        observation, mask = seen
        memory, output = agent.step(params, memory, observation)
        return pytrees.where(mask, memory, agent.memory()), output

    def log_prob(output: Output, action: Action) -> Array:
        return distribution(output).log_prob(action)

    seen = sequence.observation, sequence.mask
    _, output = jax.lax.scan(look, sequence.memory, seen)
    now = jax.vmap(log_prob)(output, sequence.action)
    return output, jnp.where(sequence.mask, now - sequence.note.log_prob, 0.0)


def units(
    tree: PyTree[Array], num_strata: int, num_actors: int, by_step: bool
) -> PyTree[Array]:
    """Cuts arrays [worlds, *actors, steps, ...] into what minibatches are dealt.

    Args:
        tree: the arrays; memory has no steps, so it is there only if worlds stay whole.
        num_strata: whose worlds follow one another.
        num_actors: how many axes of actors there are, none or one.
        by_step: whether each step is a unit, or each world.

    Returns:
        Arrays [strata, units, *actors, steps, ...], of one step each if by step.
    """

    def cut(leaf: Array) -> Array:
        if by_step:
            leaf = jnp.moveaxis(leaf, 1 + num_actors, 1)
            leaf = jnp.expand_dims(strata.merge(leaf), 1 + num_actors)
        return strata.part(leaf, num_strata)

    return jax.tree.map(cut, tree)


def each(function: Callable, num_axes: int) -> Callable:
    """Returns a function of one sequence for all along some leading axes."""
    for _ in range(num_axes):
        function = jax.vmap(function)
    return function
