"""Keeps the worlds in which a learner acts, and plays on in them."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from ..agents.base import Params
from ..sim import pytrees
from ..sim.records import Record
from . import acting, episodes, strata
from .acting import Cast, Step, World
from .base import Bank, Mean, Metrics
from .episodes import Episodes
from .strata import Share


class Stage(Record):
    """The worlds of a device, [strata, worlds of each, ...]."""

    world: World
    episode: Episodes


class Played(Record):
    """Some steps in the worlds of a device, one stratum after another."""

    before: World  # [worlds, ...]
    steps: Step  # [steps, worlds, *actors, ...]
    after: World


def begin(
    cast: Cast,
    params: Params,
    bank: Bank,
    share: Share,
    key: Key[Array, ""],
    per_stratum: int,
) -> Stage:
    """Returns worlds at the start of episodes, so many a stratum."""
    world = acting.start(cast, bank, share, key, per_stratum)
    episode = episodes.begin(step_of(cast, params, bank, share, key, world))
    return Stage(world=world, episode=pytrees.spread(episode, *world.ended.shape))


def step_of(
    cast: Cast,
    params: Params,
    bank: Bank,
    share: Share,
    key: Key[Array, ""],
    world: World,
) -> Step:
    """Returns the shapes of a step of one world."""

    def first() -> Step:
        _, steps = acting.drive(cast, params, bank, share, world, key, 1)
        return jax.tree.map(lambda leaf: leaf[0, 0, 0], steps)

    return jax.eval_shape(first)


def play(
    cast: Cast,
    params: Params,
    bank: Bank,
    share: Share,
    key: Key[Array, ""],
    stage: Stage,
    num_steps: int,
) -> tuple[Stage, Played, Metrics]:
    """Plays some steps in each world.

    Returns:
        The stage after them, the steps, and how the episodes that ended went, on this
        device (`episodes.track`).
    """
    world, steps = acting.drive(cast, params, bank, share, stage.world, key, num_steps)
    steps = jax.vmap(strata.merge)(steps)
    episode, metrics = episodes.track(strata.merge(stage.episode), steps)
    played = Played(
        before=strata.merge(stage.world), steps=steps, after=strata.merge(world)
    )
    episode = strata.part(episode, len(share.number))
    return Stage(world=world, episode=episode), played, metrics


def counts(played: Played, axis_name: str) -> Metrics:
    """Returns how many steps were played, to be added over all devices.

    Returns:
        `env_steps`, in which somebody could act, and `agent_steps`, of those who did.
    """
    shown = jnp.sum(played.before.ended) + jnp.sum(played.steps.ended[:-1])
    found = {
        "env_steps": played.steps.ended.size - shown,
        "agent_steps": jnp.sum(played.steps.mask),
    }
    weight = jnp.float32(1 / jax.lax.axis_size(axis_name))
    return {
        name: Mean(total=count.astype(jnp.float32), weight=weight)
        for name, count in found.items()
    }
