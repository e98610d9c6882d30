"""Learns the values of actions: prioritized double Q-learning from a replay."""

import dataclasses
import fractions
import functools
import math
from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, Key, PyTree

from ..agents.base import Agent, Params
from ..sim import ranges
from ..sim.dynamics.base import Discrete
from ..sim.env.base import Environment
from ..sim.env.demonstrations import Demonstration, Sample
from ..sim.records import Record
from . import acting, bc, experience, exploration, losses, optim, q_learning, strata
from .acting import Cast
from .base import Bank, Learner, Metrics, TrainState, one
from .experience import ExperienceConfig
from .exploration import ExplorationConfig
from .replay import prioritized
from .replay.prioritized import Batch
from .strata import Share

# How many transitions a device added, and how its episodes went.
Gathered = tuple[Int[Array, ""], Metrics]


@dataclasses.dataclass(frozen=True, kw_only=True)
class DQNConfig(optim.OptimizerConfig, ExperienceConfig, ExplorationConfig):
    """How an agent learns the values of actions.

    The updates of the optimizer, such as those of the warm-up, are gradient steps.

    Each update of the learner plays `num_worlds * steps_per_update` steps, and takes as
    many gradient steps as `samples_per_insertion` says.
    """

    name: Literal["dqn"] = "dqn"
    learning_rate: float = 5e-5
    batch_size: int = 64  # transitions of a gradient step, over all devices
    samples_per_insertion: float = 8.0  # transitions learned from for each one added
    huber: float | None = 1.0  # error beyond which the loss is linear; None: squared
    target_period: int = 100  # gradient steps after which the target follows
    total_steps: int = 30_000_000  # of the environment, in which beta reaches its end
    imitation_weight: float = 0.0  # of the margin of the expert's actions; 0: none
    margin: float = 0.8  # by which the expert's action should be worth more

    def __post_init__(self) -> None:
        """Checks the fields, and those of its parts.

        Raises:
            ValueError: if one is out of range, strata do not divide a count, or updates
                do not make up whole gradient steps.
        """
        optim.OptimizerConfig.__post_init__(self)
        ExperienceConfig.__post_init__(self)
        ExplorationConfig.__post_init__(self)
        strata.check(self.strata, batch_size=self.batch_size)
        ranges.require_at_least(self, target_period=1, total_steps=1)
        ranges.require_finite(self, "imitation_weight", "margin")
        if self.huber is not None and not self.huber > 0:
            raise ValueError(f"huber must be positive or null, got {self.huber}.")
        if not 0 < self.samples_per_insertion < math.inf:
            raise ValueError(
                f"samples_per_insertion must be positive, got "
                f"{self.samples_per_insertion}."
            )
        by_step = self.num_worlds * self.ratio / self.batch_size
        if (self.steps_per_update * by_step).denominator != 1:
            raise ValueError(
                f"num_worlds * steps_per_update * samples_per_insertion / batch_size, "
                f"the gradient steps of an update, must be a whole number, got "
                f"{self.num_worlds} * {self.steps_per_update} * "
                f"{self.samples_per_insertion} / {self.batch_size} = "
                f"{float(self.steps_per_update * by_step)}; make steps_per_update a "
                f"multiple of {by_step.denominator}."
            )

    @property
    def num_steps(self) -> int:
        """How many steps of worlds an update plays."""
        return self.num_worlds * self.steps_per_update

    @property
    def gradient_steps(self) -> float:
        """How many an update takes once the replay is full enough."""
        return float(self.num_steps * self.ratio / self.batch_size)

    @property
    def ratio(self) -> fractions.Fraction:
        """The exact number that `samples_per_insertion` is written as."""
        return fractions.Fraction(str(self.samples_per_insertion))


class Kept(Record):
    """What the learner remembers besides."""

    target: Params  # those of some gradient steps before
    num_gradient_steps: Int[Array, ""]
    num_env_steps: Int[Array, ""]  # transitions ever added
    owed: Int[Array, ""]  # samples not drawn yet, times the ratio's denominator


@dataclasses.dataclass(frozen=True, kw_only=True)
class Setting:
    """Who learns where, and how."""

    agent: Agent
    env: Environment
    sample: Sample  # of what the expert does
    optimizer: optim.Optimizer
    config: DQNConfig


def double_dqn(
    agent: Agent,
    env: Environment,
    sample: Sample,
    optimizer: optim.Optimizer,
    config: DQNConfig,
) -> Learner:
    """Makes a learner of double Q-learning (van Hasselt, Guez and Silver 2016).

    It acts greedily but for a share epsilon of random actions, keeps transitions in
    prioritized replays (Schaul et al. 2016), a replay a stratum, and learns from draws
    with the loss of `q_learning.means`, plus `imitation_weight` times the margin of
    `q_learning.imitation`. The published one is that of Gulino et al. 2023, A.2.

    For each transition added it learns from `samples_per_insertion` drawn ones: what is
    short of a gradient step is owed to the next update. Steps that show how an episode
    ended are no transitions and do not count. Until `min_replay` are there nothing is
    learned, and nothing owed.

    Args:
        agent: its policy are the values of actions.
        env: with one actor and numbered actions.
        sample: draws demonstrations, where `imitation_weight` is not 0.
        optimizer: of each gradient step.
        config: how.

    Raises:
        ValueError: if the actions of the environment are not numbered, it has several
            actors, or the agent remembers.
    """
    _check(agent, env)
    setting = Setting(
        agent=agent, env=env, sample=sample, optimizer=optimizer, config=config
    )
    return Learner(
        init=functools.partial(_init, setting),
        act=functools.partial(_act, setting),
        learn=functools.partial(_learn, setting),
        adopt=_adopt,
    )


def _init(
    setting: Setting, key: Key[Array, ""], bank: Bank, axis_name: str
) -> TrainState:
    config = setting.config
    key, params_key, worlds_key = jax.random.split(key, 3)
    params = setting.agent.init(params_key)
    share = strata.share(config.strata, axis_name)
    cast = Cast(setting.env, setting.agent, acting.likeliest)
    zero = jnp.zeros((), jnp.int32)
    return TrainState(
        params=params,
        opt_state=setting.optimizer.transformation.init(params),
        step=zero,
        key=key,
        kept=Kept(
            target=params, num_gradient_steps=zero, num_env_steps=zero, owed=zero
        ),
        worlds=experience.begin(cast, config, params, bank, share, worlds_key),
    )


def _act(
    setting: Setting, train_state: TrainState, bank: Bank, axis_name: str
) -> tuple[TrainState, Gathered]:
    config, env = setting.config, setting.env
    key, act_key = jax.random.split(train_state.key)
    epsilon = exploration.epsilon(config, train_state.kept.num_env_steps)
    explore = exploration.greedy(epsilon, env.action_spec.num_actions)
    worlds, added, metrics = experience.act(
        Cast(env, setting.agent, explore),
        config,
        train_state.params,
        bank,
        strata.share(config.strata, axis_name),
        train_state.worlds,
        act_key,
    )
    return train_state.replace(key=key, worlds=worlds), (added, metrics)


def _learn(
    setting: Setting,
    train_state: TrainState,
    gathered: Gathered,
    bank: Bank,
    axis_name: str,
) -> tuple[TrainState, Metrics]:
    config = setting.config
    key, learn_key = jax.random.split(train_state.key)
    share = strata.share(config.strata, axis_name)
    kept, worlds = train_state.kept, train_state.worlds
    num_updates = train_state.step
    epsilon = exploration.epsilon(config, kept.num_env_steps)
    num_items = jnp.sum(jax.vmap(lambda replay: replay.num_items)(worlds.replay))
    (added, metrics), num_items = jax.lax.psum((gathered, num_items), axis_name)
    num_steps, owed = _due(config, kept.owed, added, num_items)
    kept = kept.replace(num_env_steps=kept.num_env_steps + added, owed=owed)

    step = _gradient_step(setting, bank, share, axis_name)
    before = train_state.replace(key=learn_key, kept=kept, worlds=worlds.replay)
    after, learned = _repeat(step, num_steps, before)
    train_state = after.replace(
        step=num_updates + 1, key=key, worlds=worlds.replace(replay=after.worlds)
    )
    counts = {
        "env_steps": added,
        "replay_size": num_items,
        "epsilon": epsilon,
        "gradient_steps": num_steps,
    }
    counts = {name: one(count) for name, count in counts.items()}
    return train_state, metrics | learned | counts


def _adopt(train_state: TrainState, params: Params) -> TrainState:
    # A copy: the program, which is given both, may write over either.
    kept = train_state.kept.replace(target=jax.tree.map(jnp.copy, params))
    return train_state.replace(params=params, kept=kept)


def _check(agent: Agent, env: Environment) -> None:
    if not isinstance(env.action_spec, Discrete):
        raise ValueError(
            f"dqn needs one actor with numbered actions, got {env.action_spec}; take "
            "discrete dynamics in the planning environment."
        )
    if agent.remembers:
        raise ValueError(
            "dqn learns from single transitions, so its agent cannot remember; take "
            "one without memory, or ppo."
        )


def _due(
    config: DQNConfig,
    owed: Int[Array, ""],
    added: Int[Array, ""],
    num_items: Int[Array, ""],
) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Returns how many gradient steps to take now, and what is owed after them."""
    ratio, is_full = config.ratio, num_items >= config.min_replay
    owed += jnp.where(is_full, added * ratio.numerator, 0)
    cost = config.batch_size * ratio.denominator
    return owed // cost, owed % cost


def _repeat(
    step: Callable[[TrainState], tuple[TrainState, Metrics]],
    num_steps: Int[Array, ""],
    train_state: TrainState,
) -> tuple[TrainState, Metrics]:
    """Takes gradient steps; the metrics are means over all of them."""
    _, like = jax.eval_shape(step, train_state)
    none = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), like)
    # The items stay as they are, outside of the loop: several seeds side by side would
    # copy at each turn whatever goes through it.
    items = train_state.worlds.items

    def with_items(train_state: TrainState, items: PyTree[Array]) -> TrainState:
        return train_state.replace(worlds=train_state.worlds.replace(items=items))

    def again(_, carry: tuple[TrainState, Metrics]) -> tuple[TrainState, Metrics]:
        train_state, sums = carry
        train_state, metrics = step(with_items(train_state, items))
        return with_items(train_state, ()), jax.tree.map(jnp.add, sums, metrics)

    carry = with_items(train_state, ()), none
    train_state, metrics = jax.lax.fori_loop(0, num_steps, again, carry)
    return with_items(train_state, items), metrics


def _gradient_step(
    setting: Setting, bank: Bank, share: Share, axis_name: str
) -> Callable[[TrainState], tuple[TrainState, Metrics]]:
    """Returns what learns from one batch; the worlds of its state are the replays."""
    config, optimizer = setting.config, setting.optimizer
    per_stratum = config.batch_size // config.strata
    loss = _loss(setting.agent, config, axis_name)

    def step(train_state: TrainState) -> tuple[TrainState, Metrics]:
        key, draw_key, expert_key = jax.random.split(train_state.key, 3)
        kept, replay = train_state.kept, train_state.worlds
        beta = prioritized.importance_exponent(
            config.replay, kept.num_env_steps / config.total_steps
        )
        draw = jax.vmap(prioritized.sample, in_axes=(0, 0, None, None))
        batch = draw(replay, share.keys(draw_key), per_stratum, beta)
        batch = prioritized.weigh_together(batch, (axis_name,))
        shown = None
        if config.imitation_weight:
            shown = bc.draw(setting.sample, bank, share, expert_key, per_stratum)

        counted = train_state.replace(step=kept.num_gradient_steps, key=key)
        counted, metrics, td_errors = optim.descend(
            optimizer, counted, axis_name, loss, kept.target, batch, shown
        )
        rate = jax.vmap(prioritized.set_priorities, in_axes=(None, 0, 0, 0))
        replay = rate(config.replay, replay, batch.indices, td_errors)
        target = optax.periodic_update(
            counted.params, kept.target, counted.step, config.target_period
        )
        kept = kept.replace(target=target, num_gradient_steps=counted.step)
        return counted.replace(step=train_state.step, kept=kept, worlds=replay), metrics

    return step


def _loss(agent: Agent, config: DQNConfig, axis_name: str) -> optim.Loss:
    """Returns the loss of a batch and, if any, of demonstrations, with the errors."""

    def loss(
        params: Params, target: Params, batch: Batch, shown: Demonstration | None
    ) -> tuple[Metrics, Float[Array, "strata batch"]]:
        error = functools.partial(q_learning.td_error, agent, params, target)
        errors, values = jax.vmap(jax.vmap(error))(batch.items)
        metrics = q_learning.means(batch.weights, errors, values, config.huber)
        if shown is not None:
            margin = q_learning.imitation(agent, params, shown, config.margin)
            parts = [(1.0, metrics["loss"]), (config.imitation_weight, margin)]
            metrics |= {"margin": margin, "loss": losses.combine(parts, axis_name)}
        return metrics, errors

    return loss
