"""Lets an agent drive: the one path by which learners act and evaluations play."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key, PRNGKeyArray, PyTree

from ..agents.base import Agent, Memory, Output, Params
from ..sim import pytrees
from ..sim.data.bank import Bank
from ..sim.data.stratum import Stratum
from ..sim.dynamics.base import Action
from ..sim.env import rollout
from ..sim.env.base import Act, Driver, Environment, State
from ..sim.metrics.base import Measure, only
from ..sim.observations.base import Observation
from ..sim.records import Record
from ..sim.scene import Scene
from . import actors, strata
from .strata import Share

RESTARTS = 16  # as many parts of the worlds begin anew one after another, if all do

# Of what an agent makes of an observation: an action, and what to remember of it.
Choose = Callable[[Output, PRNGKeyArray], tuple[Action, PyTree]]


class World(Record):
    """A world, and the agent in it, between two steps."""

    state: State
    memory: Memory  # of each actor
    ended: Bool[Array, ""]  # the episode is over: shown once more, then begun anew


class Step(Record):
    """One step of each actor: the ego in planning, in multi-agent whoever may act.

    The step after the last of an episode is there too, with the observation of how it
    ended and a mask of False: what is missed by ending early, `value_tp1`, can be told
    from it. Other steps without mask are those of objects that did not act.
    """

    observation: Observation
    action: Action
    note: PyTree  # what the learner remembers of the choice
    reward: Float[Array, "*actors"]
    discount: Float[Array, "*actors"]  # of what follows; 0 where it counts no more
    mask: Bool[Array, "*actors"]
    ended: Bool[Array, ""]  # the episode ended with this step
    measures: dict[str, Measure]


@dataclasses.dataclass(frozen=True)
class Cast:
    """Who plays what, and how actions are chosen."""

    env: Environment
    agent: Agent
    choose: Choose


def likeliest(output: Output, key: PRNGKeyArray) -> tuple[Action, tuple[()]]:
    """Chooses the action that the agent finds best, and remembers nothing."""
    del key
    return output.policy.mode(), ()


def start(
    cast: Cast, bank: Bank, share: Share, key: Key[Array, ""], per_stratum: int
) -> World:
    """Returns worlds at the start of episodes, [strata, worlds of each, ...]."""

    def of_stratum(stratum: Stratum, key: PRNGKeyArray) -> World:
        keys = jax.random.split(key, per_stratum)
        return jax.vmap(begin, in_axes=(None, None, None, 0))(cast, bank, stratum, keys)

    worlds = jax.vmap(of_stratum)(share.stratum, share.keys(key))
    # What is the same in every world, such as that no episode is over, is so by chance:
    # chosen by what differs from device to device, it counts as each device's own.
    return pytrees.where(share.number >= 0, worlds, worlds)


def drive(
    cast: Cast,
    params: Params,
    bank: Bank,
    share: Share,
    worlds: World,
    key: Key[Array, ""],
    num_steps: int,
) -> tuple[World, Step]:
    """Plays some steps in all worlds of a device.

    Args:
        cast: who plays.
        params: of the agent.
        bank: the scenarios.
        share: the strata of the device.
        worlds: at the start, as `start` returns them.
        key: of what is random, the same on all devices.
        num_steps: how many steps.

    Returns:
        The worlds after the last step, and the steps,
        [steps, strata, worlds of each, *actors, ...].
    """
    num_strata, per_stratum = worlds.ended.shape
    keys = jax.vmap(lambda key: jax.random.split(key, per_stratum))(share.keys(key))
    spread = jax.tree.map(
        lambda leaf: jnp.repeat(leaf, per_stratum, axis=0), share.stratum
    )
    flat, keys = strata.merge((worlds, keys))
    flat, steps = unroll(cast, params, bank, spread, flat, keys, num_steps)
    by_stratum = functools.partial(strata.part, num_strata=num_strata)
    return by_stratum(flat), jax.vmap(by_stratum)(steps)


def begin(cast: Cast, bank: Bank, stratum: Stratum, key: PRNGKeyArray) -> World:
    """Returns a world at the start of an episode in a random scenario of a stratum."""
    state = rollout.begin(cast.env, bank, stratum, key)
    return World(
        state=state,
        memory=actors.memory(cast.env, cast.agent, len(state.admitted)),
        ended=jnp.bool_(False),
    )


def unroll(
    cast: Cast,
    params: Params,
    bank: Bank,
    stratum: Stratum,
    worlds: World,
    keys: Key[Array, " worlds"],
    num_steps: int,
) -> tuple[World, Step]:
    """Plays some steps in many worlds; where an episode ends, another begins.

    Args:
        cast: who plays.
        params: of the agent.
        bank: the scenarios.
        stratum: of each world, those that it may play.
        worlds: at the start, with a leading axis.
        keys: of each world.
        num_steps: how many steps.

    Returns:
        The worlds after the last step, and the steps, [steps, worlds, *actors, ...].
    """
    play = jax.vmap(_play, in_axes=(None, None, None, 0, 0))

    def step(worlds: World, number: Array) -> tuple[World, Step]:
        now = jax.vmap(jax.random.fold_in, in_axes=(0, None))(keys, number)
        own = jax.vmap(jax.random.split)(now)
        following, steps = play(cast, params, bank, worlds, own[:, 0])
        # Whoever was shown how it ended begins anew.
        fresh = _restart(cast, bank, stratum, following, worlds.ended, own[:, 1])
        return pytrees.where(worlds.ended, fresh, following), steps

    # What is needed to differentiate a step is computed again, not kept.
    return jax.lax.scan(jax.checkpoint(step), worlds, jnp.arange(num_steps))


def _restart(
    cast: Cast,
    bank: Bank,
    stratum: Stratum,
    worlds: World,
    ended: Bool[Array, " worlds"],
    keys: Key[Array, " worlds"],
) -> World:
    """Returns worlds of which those that ended begin anew, and others may be anything.

    Beginning costs as much as some steps, and where episodes end at different times
    few do at once: so a few worlds begin at a time, until all have that are to.
    """
    few = -(-len(ended) // RESTARTS)
    those_first, count = jnp.argsort(~ended), jnp.sum(ended)
    anew = jax.vmap(begin, in_axes=(None, None, 0, 0))

    def are_left(carry: tuple[Array, World]) -> Array:
        return carry[0] < count

    def restart(carry: tuple[Array, World]) -> tuple[Array, World]:
        first, worlds = carry
        some = jax.lax.dynamic_slice_in_dim(those_first, first, few)
        own = jax.tree.map(lambda leaf: leaf[some], (stratum, keys))
        fresh = anew(cast, bank, *own)
        worlds = jax.tree.map(lambda leaf, new: leaf.at[some].set(new), worlds, fresh)
        return first + few, worlds

    # No gradient goes through the start of an episode, nor could it through a loop.
    carry = jnp.zeros((), count.dtype), jax.lax.stop_gradient(worlds)
    return jax.lax.while_loop(are_left, restart, carry)[1]


def _play(
    cast: Cast, params: Params, bank: Bank, world: World, key: PRNGKeyArray
) -> tuple[World, Step]:
    """Plays one step in one world."""
    env, agent = cast.env, cast.agent
    observation = env.observe(bank, world.state)
    memory, output = actors.each(env, agent.step, (None, 0, 0))(
        params, world.memory, observation
    )
    keys = actors.keys(env, world.state, key)
    action, note = actors.each(env, cast.choose, (0, 0))(output, keys)
    act = actors.act(env, world.state, action)
    state, timestep = env.step(bank, world.state, act)
    ended = rollout.has_ended(timestep) & ~world.ended
    acted, reward, discount, measures = actors.of_actors(
        env,
        world.state,
        (timestep.acted, timestep.reward, timestep.discount, timestep.measures),
    )
    mask = acted & ~world.ended
    steps = Step(
        observation=observation,
        action=action,
        note=note,
        reward=jnp.where(mask, reward, 0.0),
        discount=discount,
        mask=mask,
        ended=ended,
        measures=only(measures, mask),
    )
    fresh = actors.memory(env, agent, len(state.admitted))
    memory = pytrees.where(mask, memory, fresh)
    return World(state=state, memory=memory, ended=ended), steps


def greedy(agent: Agent, env: Environment) -> Callable[[PyTree, Array], Driver]:
    """Builds the driver that takes the agent's most likely action.

    Returns:
        A function of the agent's parameters and the number of a scenario.
    """

    def driver_of(params: PyTree, number: Array) -> Driver:
        del number

        def act(
            memory: Memory, bank: Bank, state: State, key: PRNGKeyArray
        ) -> tuple[Memory, Act]:
            del key
            observation = env.observe(bank, state)
            step = actors.each(env, agent.step, (None, 0, 0))
            memory, output = step(params, memory, observation)
            mode = actors.each(env, lambda output: output.policy.mode(), (0,))
            act = actors.act(env, state, mode(output))
            if not actors.is_multi_agent(env):
                return memory, act
            here = state.controlled & state.motion.valid
            fresh = actors.memory(env, agent, len(here))
            return pytrees.where(actors.of_actors(env, state, here), memory, fresh), act

        def reset(scene: Scene) -> Memory:
            memory = actors.memory(env, agent, len(scene.object_mask))
            # Chosen by the scene, so that it counts as the device's own, as in `act`.
            return pytrees.where(scene.index >= 0, memory, memory)

        return Driver(reset, act)

    return driver_of
