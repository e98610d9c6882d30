"""Plays worlds and keeps what happened, for learners that learn from it later."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key, PyTree

from ..agents.base import Agent, Output, Params
from ..sim.dynamics.base import Action
from ..sim.env.base import Environment
from ..sim.observations.base import Observation
from ..sim.records import Record
from . import acting, episodes, strata
from .acting import Choose, Step, World
from .base import Bank, Metrics
from .episodes import Episodes
from .replay import prioritized
from .replay.prioritized import Replay, ReplayConfig
from .strata import Share
from .transitions import Transition, transitions


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExperienceConfig:
    """How much is played and kept; counts are over all devices."""

    strata: int = 8  # equal parts of all; the number of devices must divide it
    num_worlds: int = 64  # played side by side
    steps_per_update: int = 8  # of each world
    n_step: int = 1  # of a transition; fewer where an episode or an update ends
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
        if not 1 <= self.n_step <= self.steps_per_update:
            raise ValueError(
                f"n_step must be from 1 to steps_per_update, since no transition "
                f"reaches beyond an update, got {self.n_step} and "
                f"{self.steps_per_update}."
            )
        if not 0 <= self.discount <= 1:
            raise ValueError(f"discount must be from 0 to 1, got {self.discount}.")
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

    worlds: World  # of a stratum several
    episodes: Episodes  # of each world
    replay: Replay  # of a stratum one


@dataclasses.dataclass(frozen=True)
class Collector:
    """A pair of functions of the share of a device.

    `begin(params, bank, share, key)` starts its worlds, with nothing kept.
    `act(params, choose, bank, share, experience, key)` plays them on and adds their
    transitions; it returns how many, and the metrics of the episodes that ended
    (`episodes.track`), both of this device.
    """

    begin: Callable[[Params, Bank, Share, Key[Array, ""]], Experience]
    act: Callable[
        [Params, Choose, Bank, Share, Experience, Key[Array, ""]],
        tuple[Experience, Int[Array, ""], Metrics],
    ]


def collector(env: Environment, agent: Agent, config: ExperienceConfig) -> Collector:
    """Builds the collector of experience of one actor a world.

    Observations are kept as they were seen, in their own precision. Steps that are no
    transitions, such as the one that shows how an episode ended, are not kept.
    """
    per_stratum = config.num_worlds // config.strata

    def begin(
        params: Params, bank: Bank, share: Share, key: Key[Array, ""]
    ) -> Experience:
        worlds = acting.start(env, agent, bank, share, key, per_stratum)

        def step() -> Step:
            drive = functools.partial(acting.drive, num_steps=1)
            _, steps = drive(env, agent, params, _mode, bank, share, worlds, key)
            return jax.tree.map(lambda leaf: leaf[0, 0, 0], steps)

        like = jax.eval_shape(step)
        item = Transition(
            observation_t=like.observation,
            action_t=like.action,
            return_t=like.reward,
            discount_tpn=like.discount,
            observation_tpn=like.observation,
        )
        replay = prioritized.make(item, config.replay.capacity // config.strata)
        num_strata = len(share.number)
        return Experience(
            worlds=worlds,
            episodes=_copies(episodes.begin(like), num_strata, per_stratum),
            replay=_copies(replay, num_strata),
        )

    def act(
        params: Params,
        choose: Choose,
        bank: Bank,
        share: Share,
        experience: Experience,
        key: Key[Array, ""],
    ) -> tuple[Experience, Int[Array, ""], Metrics]:
        drive = functools.partial(acting.drive, num_steps=config.steps_per_update)
        worlds, steps = drive(
            env, agent, params, choose, bank, share, experience.worlds, key
        )
        running, metrics = jax.vmap(episodes.track, (0, 1))(experience.episodes, steps)
        observe = functools.partial(env.observe, bank)
        last = jax.vmap(jax.vmap(observe))(worlds.state)

        def add(replay: Replay, steps: Step, last: Observation) -> tuple[Replay, Array]:
            cut = functools.partial(
                transitions, num_steps=config.n_step, discount=config.discount
            )
            # Of the same step, those of all worlds are of the same age.
            of_worlds = jax.vmap(cut, in_axes=(1, 0), out_axes=1)(steps, last)
            items, valid = strata.merge(of_worlds)
            return prioritized.add(replay, items, valid), jnp.sum(valid)

        replay, added = jax.vmap(add, (0, 1, 0))(experience.replay, steps, last)
        played = Experience(worlds=worlds, episodes=running, replay=replay)
        return played, jnp.sum(added), jax.tree.map(jnp.sum, metrics)

    return Collector(begin=begin, act=act)


def _mode(output: Output, key: Key[Array, ""]) -> tuple[Action, tuple]:
    del key
    return output.policy.mode(), ()


def _copies(tree: PyTree[Array], *shape: int) -> PyTree[Array]:
    """Returns the same arrays many times over, along new leading axes."""
    return jax.tree.map(
        lambda leaf: jnp.broadcast_to(
            jnp.expand_dims(leaf, range(len(shape))), (*shape, *leaf.shape)
        ),
        tree,
    )
