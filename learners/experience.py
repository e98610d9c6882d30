"""Plays worlds and keeps what happened, for learners that learn from it later."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key

from ..agents.base import Params
from ..sim import pytrees, ranges
from ..sim.observations.base import Observation
from ..sim.records import Record
from . import stage as stages, strata
from .acting import Cast, Step
from .base import Bank, Metrics
from .replay import prioritized
from .replay.prioritized import Replay, ReplayConfig
from .stage import Stage
from .strata import Share
from .transitions import Transition, transitions


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExperienceConfig:
    """How much is played and kept; counts are over all devices."""

    strata: int = 8  # equal parts of all; the number of devices must divide it
    num_worlds: int = 64  # played side by side
    steps_per_update: int = 8  # of each world
    n_step: int = 1  # of a transition; fewer where an episode ends
    discount: float = 0.99  # gamma, of a step
    min_replay: int = 10_000  # items, before which nothing is learned
    replay: ReplayConfig = dataclasses.field(
        default_factory=lambda: ReplayConfig(capacity=100_000)
    )

    def __post_init__(self) -> None:
        """Checks the counts.

        Raises:
            ValueError: if one is out of range, or strata do not divide it.
        """
        capacity = self.replay.capacity
        strata.check(self.strata, num_worlds=self.num_worlds)
        strata.check(self.strata, **{"replay.capacity": capacity})
        ranges.require_at_least(self, steps_per_update=1, n_step=1)
        ranges.require_share(self, "discount")
        if self.num_worlds * self.steps_per_update > capacity:
            raise ValueError(
                f"replay.capacity must hold the num_worlds * steps_per_update = "
                f"{self.num_worlds * self.steps_per_update:,} items of an update, got "
                f"{capacity:,}."
            )
        if not 1 <= self.min_replay <= capacity:
            raise ValueError(
                f"min_replay must be from 1 to replay.capacity, got "
                f"{self.min_replay:,} and {capacity:,}."
            )


class Experience(Record):
    """Worlds and what is kept of them, all with a leading axis of strata."""

    stage: Stage  # of a stratum several worlds
    recent: (
        Step  # the last n_step - 1, [strata, steps, worlds, ...]: no transitions yet
    )
    replay: Replay  # of a stratum one


def begin(
    cast: Cast,
    config: ExperienceConfig,
    params: Params,
    bank: Bank,
    share: Share,
    key: Key[Array, ""],
) -> Experience:
    """Starts the worlds of a device, with nothing kept.

    Args:
        cast: who plays, one actor a world.
        config: how many worlds there are, and how much is kept.
        params: of the agent.
        bank: the scenarios.
        share: the strata of the device.
        key: of what is random, the same on all devices.
    """
    per_stratum = config.num_worlds // config.strata
    stage = stages.begin(cast, params, bank, share, key, per_stratum)
    like = stages.step_of(cast, params, bank, share, key, stage.world)
    item = Transition(
        observation_t=like.observation,
        action_t=like.action,
        return_t=like.reward,
        discount_tpn=like.discount,
        observation_tpn=like.observation,
    )
    replay = prioritized.make(item, config.replay.capacity // config.strata)
    num_strata, num_recent = len(share.number), config.n_step - 1
    nothing = jax.tree.map(
        lambda leaf: jnp.zeros((num_recent, per_stratum, *leaf.shape), leaf.dtype),
        _lean(like),
    )
    return Experience(
        stage=stage,
        recent=pytrees.spread(nothing, num_strata),
        replay=pytrees.spread(replay, num_strata),
    )


def act(
    cast: Cast,
    config: ExperienceConfig,
    params: Params,
    bank: Bank,
    share: Share,
    experience: Experience,
    key: Key[Array, ""],
) -> tuple[Experience, Int[Array, ""], Metrics]:
    """Plays the worlds of a device on, and adds the transitions that are whole by then.

    Observations are kept as they were seen, in their own precision. Steps that are no
    transitions, such as the one that shows how an episode ended, are not kept.

    Returns:
        What there is now, how many transitions were added, and the metrics of the
        episodes that ended (`episodes.track`), both of this device.
    """
    num_steps = config.steps_per_update
    stage, played, metrics = stages.play(
        cast, params, bank, share, key, experience.stage, num_steps
    )
    cut = functools.partial(
        transitions, num_steps=config.n_step, discount=config.discount
    )

    def add(
        replay: Replay, recent: Step, steps: Step, last: Observation
    ) -> tuple[Replay, Step, Int[Array, ""]]:
        """Adds what is found in the worlds of a stratum."""
        known = jax.tree.map(
            lambda old, new: jnp.concatenate([old, new]), recent, steps
        )
        # Of the same step, those of all worlds are of the same age.
        found = jax.vmap(cut, in_axes=(1, 0), out_axes=1)(known, last)
        items, valid = strata.merge(found)
        recent = jax.tree.map(lambda leaf: leaf[num_steps:], known)
        return prioritized.add(replay, items, valid), recent, jnp.sum(valid)

    by_stratum = functools.partial(strata.part, num_strata=len(share.number))
    last = jax.vmap(cast.env.observe, in_axes=(None, 0))(bank, played.after.state)
    replay, recent, added = jax.vmap(add, in_axes=(0, 0, 1, 0))(
        experience.replay,
        experience.recent,
        jax.vmap(by_stratum)(_lean(played.steps)),
        by_stratum(last),
    )
    experience = Experience(stage=stage, recent=recent, replay=replay)
    return experience, jnp.sum(added), metrics


def _lean(steps: Step) -> Step:
    """Returns steps without what no transition is made of."""
    return steps.replace(note=(), measures={})
