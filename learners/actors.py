"""Tells who acts in a world: the ego, or whichever objects an environment lists."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key, PRNGKeyArray

from ..agents.base import Agent, Memory
from ..sim import pytrees
from ..sim.dynamics.base import Action, ActionSpec
from ..sim.env import controlled
from ..sim.env.base import Act, Environment, State
from ..sim.observations.base import Observation

Tree = TypeVar("Tree")


def is_multi_agent(env: Environment) -> bool:
    """Tells whether objects act, or the ego alone."""
    return isinstance(env.action_spec, tuple)


def action_spec(env: Environment) -> ActionSpec:
    """Returns the actions of each actor.

    Raises:
        ValueError: if there are several teams, whose actions may differ.
    """
    if not is_multi_agent(env):
        return env.action_spec
    if len(env.action_spec) != 1:
        raise ValueError(
            f"an agent drives one team, got a task of {len(env.action_spec)}."
        )
    return env.action_spec[0]


def first(env: Environment, observation: Observation) -> Observation:
    """Returns what the first actor sees."""
    if not is_multi_agent(env):
        return observation
    return jax.tree.map(lambda leaf: leaf[0], observation)


def each(env: Environment, function: Callable, axes: tuple) -> Callable:
    """Returns a function of one actor for all of a world."""
    return jax.vmap(function, in_axes=axes) if is_multi_agent(env) else function


def memory(env: Environment, agent: Agent, num_objects: int) -> Memory:
    """Returns what each actor remembers before its first step."""
    blank = agent.memory()
    if not is_multi_agent(env):
        return blank
    return pytrees.spread(blank, controlled.num_actors(env.max_actors, num_objects))


def keys(env: Environment, state: State, key: PRNGKeyArray) -> Key[Array, "*actors"]:
    """Returns a key for each actor."""
    if not is_multi_agent(env):
        return key
    num_actors = controlled.num_actors(env.max_actors, len(state.admitted))
    return jax.random.split(key, num_actors)


def of_actors(env: Environment, state: State, of_objects: Tree) -> Tree:
    """Returns of each actor what an environment tells of each object.

    Where nobody sits it is zero, and False.
    """
    if not is_multi_agent(env):
        return of_objects
    numbers = controlled.actors(env.max_actors, state)

    def of_leaf(leaf: Array) -> Array:
        return jnp.take(leaf, numbers, axis=0, mode="fill", fill_value=0)

    return jax.tree.map(of_leaf, of_objects)


def act(env: Environment, state: State, action: Action) -> Act:
    """Returns what the environment is to be given for the actions of each actor."""
    if not is_multi_agent(env):
        return action
    numbers = controlled.actors(env.max_actors, state)
    idle = jnp.zeros((len(state.admitted), *action.shape[1:]), action.dtype)
    return (idle.at[numbers].set(action, mode="drop"),)
