"""Begins worlds, moves them on and shows them: what all tasks have in common."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from .. import motions
from ..data.bank import Bank
from ..goals import logged_goal
from ..metrics.base import Moment
from ..motion import Motion
from ..observations.base import View
from ..scene import Scene
from ..sim_agents.base import Carry, SimAgent
from . import starts
from .base import State, Team
from .starts import StartConfig, StartScene


def begin(
    bank: Bank,
    index: Int[Array, ""],
    key: PRNGKeyArray,
    teams: Sequence[Team],
    sim_agent: SimAgent,
    history: int,
    config: StartConfig,
    max_actors: int | None = None,
) -> State:
    """Returns a world at the start of an episode.

    Args:
        bank: of scenarios.
        index: of the scenario.
        key: of all that is random in the episode.
        teams: who is controlled; an object that several claim belongs to the first.
        sim_agent: drives all others.
        history: steps before the start that the world remembers, from the log.
        config: when the episode begins, and how far off the log.
        max_actors: how many the teams control together, the first ones; None: all.
    """
    key, step_key, noise_key = jax.random.split(key, 3)
    step = starts.choose(config, Scene(bank=bank, index=index), step_key)
    scene = StartScene(bank=bank, index=index, start=step, key=key)
    masks, free = [], scene.object_mask
    for team in teams:
        masks.append(team.controls(scene) & free)
        free &= ~masks[-1]
    taken = jnp.any(jnp.stack(masks), axis=0)
    if max_actors is not None:
        taken &= jnp.cumsum(taken) <= max_actors
        masks = [mask & taken for mask in masks]
    motion = starts.disturb(config, scene.log_at(step), taken, noise_key)
    return State(
        index=index,
        step=step,
        motion=motion,
        history=jax.vmap(scene.log_at)(step - history + jnp.arange(history)),
        object_size=scene.object_size,
        sim_agent=sim_agent.reset(scene),
        goal=logged_goal(scene, motion),
        teams=tuple(masks),
        removable=taken,
        admitted=scene.object_mask,
        controls=_coasting(bank, teams, masks, motion),
        key=key,
    )


def _coasting(bank, teams, masks, motion: Motion) -> Float[Array, "objects features"]:
    """Returns the controls of coasting; teams with fewer than others end with zeros."""
    held = [t.dynamics.controls(t.dynamics.coast(motion, bank.dt)) for t in teams]
    width = max(controls.shape[-1] for controls in held)
    coasting = jnp.zeros((len(motion.valid), width))
    for mask, controls in zip(masks, held, strict=True):
        there = mask & motion.valid
        coasting = jnp.where(there[:, None], pad(controls, width), coasting)
    return coasting


def pad(
    controls: Float[Array, "objects features"], width: int
) -> Float[Array, "objects width"]:
    """Appends zeros to the controls of each object."""
    return jnp.pad(controls, [(0, 0), (0, width - controls.shape[-1])])


def moment(scene: Scene, state: State, moved: Motion, logged: Motion) -> Moment:
    """Returns what happens in a step.

    Args:
        scene: of the world.
        state: before the step.
        moved: everybody after the step, in the plane.
        logged: the log after the step, where heights come from.
    """
    return Moment(
        scene=scene,
        object_size=state.object_size,
        step=state.step + 1,
        before=state.motion,
        after=motions.on_the_ground(moved, state.motion, logged),
        logged=logged,
        goal=state.goal,
    )


def follow(
    state: State,
    motion: Motion,
    sim_agent: Carry,
    controls: Float[Array, "objects features"],
) -> State:
    """Returns the world one step later.

    Args:
        state: before the step.
        motion: after it.
        sim_agent: what the sim agent remembers after it.
        controls: of the actions that led to it.
    """
    seen = motions.append(state.history, state.motion)
    return state.replace(
        step=state.step + 1,
        motion=motion,
        history=jax.tree.map(lambda leaf: leaf[1:], seen),
        sim_agent=sim_agent,
        controls=controls,
    )


def view(bank: Bank, state: State) -> View:
    """Returns the world as observers see it."""
    return View(
        scene=Scene(bank=bank, index=state.index),
        step=state.step,
        motion=motions.append(state.history, state.motion),
        object_size=state.object_size,
        goal=state.goal,
        controls=state.controls,
        key=jax.random.fold_in(state.key, state.step),
    )
