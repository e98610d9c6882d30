"""Adds up the episodes that end while learning: returns, lengths and flags."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..sim import pytrees
from ..sim.metrics.aggregate import FLAGS
from ..sim.metrics.base import Measure
from ..sim.records import Record
from .acting import Step
from .base import Mean, Metrics


class Episodes(Record):
    """The episode that a world is in, so far, of each actor."""

    total_reward: Float[Array, "*actors"]  # not discounted
    num_steps: Int[Array, "*actors"]  # in which it acted
    flagged: dict[str, Bool[Array, "*actors"]]  # at some step, by the metric's name
    measured: dict[str, Bool[Array, "*actors"]]  # likewise


class _Seen(Record):
    """What is read of a step."""

    reward: Float[Array, "*actors"]
    mask: Bool[Array, "*actors"]
    ended: Bool[Array, ""]
    flags: dict[str, Measure]


def begin(step: Step) -> Episodes:
    """Returns a world's episode before its first step.

    Args:
        step: of one world; only its shapes are read, so what `jax.eval_shape` returns
            will do.
    """
    flags, shape = _flags(step), step.reward.shape
    return Episodes(
        total_reward=jnp.zeros(shape),
        num_steps=jnp.zeros(shape, jnp.int32),
        flagged={name: jnp.zeros(shape, bool) for name in flags},
        measured={name: jnp.zeros(shape, bool) for name in flags},
    )


def track(episodes: Episodes, steps: Step) -> tuple[Episodes, Metrics]:
    """Goes on counting in many worlds.

    Args:
        episodes: of each world, with a leading axis.
        steps: of an unroll, [steps, worlds, *actors, ...].

    Returns:
        The episodes that go on, and means over those that ended: `episode/return`,
        `episode/length` and the rates of `aggregate.FLAGS`, such as
        `episode/collision`. The episodes of an actor that never acted, or for a rate
        was never measured, do not count. The means are of the worlds given: of all
        devices by `jax.lax.psum`.
    """
    seen = _Seen(
        reward=steps.reward, mask=steps.mask, ended=steps.ended, flags=_flags(steps)
    )
    episodes, means = jax.vmap(_track_one, in_axes=(0, 1))(episodes, seen)
    return episodes, jax.tree.map(jnp.sum, means)


def _track_one(episodes: Episodes, steps: _Seen) -> tuple[Episodes, Metrics]:
    """Counts in one world."""

    def add(episodes: Episodes, step: _Seen) -> tuple[Episodes, Metrics]:
        episodes = _add(episodes, step)
        fresh = jax.tree.map(jnp.zeros_like, episodes)
        going_on = pytrees.where(step.ended, fresh, episodes)
        return going_on, _figures(episodes, step.ended)

    episodes, means = jax.lax.scan(add, episodes, steps)
    return episodes, jax.tree.map(jnp.sum, means)


def _add(episodes: Episodes, step: _Seen) -> Episodes:
    return Episodes(
        total_reward=episodes.total_reward + jnp.where(step.mask, step.reward, 0.0),
        num_steps=episodes.num_steps + step.mask,
        flagged={
            name: episodes.flagged[name] | (flag.valid & (flag.value > 0))
            for name, flag in step.flags.items()
        },
        measured={
            name: episodes.measured[name] | flag.valid
            for name, flag in step.flags.items()
        },
    )


def _figures(episodes: Episodes, ended: Bool[Array, ""]) -> Metrics:
    """Returns the means over the actors whose episode ended."""
    counts = ended & (episodes.num_steps > 0)
    means = {
        "return": _mean(episodes.total_reward, counts),
        "length": _mean(episodes.num_steps, counts),
    }
    for name, flagged in episodes.flagged.items():
        means[name] = _mean(flagged, ended & episodes.measured[name])
    return {f"episode/{name}": mean for name, mean in means.items()}


def _mean(values: Array, counts: Bool[Array, "*actors"]) -> Mean:
    return Mean(
        total=jnp.sum(jnp.where(counts, values, 0), dtype=jnp.float32),
        weight=jnp.sum(counts, dtype=jnp.float32),
    )


def _flags(step: Step) -> dict[str, Measure]:
    return {name: step.measures[name] for name in FLAGS if name in step.measures}
