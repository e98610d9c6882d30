"""Learns by proximal policy optimization: acts, and repeats what turned out well."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key

from ..agents.base import Agent, Params
from ..sim import ranges
from ..sim.env.base import Environment
from ..sim.env.demonstrations import Sample
from ..sim.records import Record
from . import (
    appraisal,
    bc,
    normalizer as normalizers,
    optim,
    pasts,
    rehearsal,
    sequences,
    stage as stages,
    strata,
)
from .acting import Cast
from .appraisal import AppraisalConfig, Study
from .base import Bank, Learner, Mean, Metrics, TrainState
from .normalizer import Normalizer
from .pasts import Pasts
from .rehearsal import Lesson, Pupil, RehearsalConfig
from .returns import Worth

# The task, some of whose sim agents may act by parameters that the agent once had.
EnvironmentOf = Callable[[Pasts | tuple[()]], Environment]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PPOConfig(optim.OptimizerConfig, AppraisalConfig, RehearsalConfig):
    """How an agent improves by acting; the optimizer's updates are gradient steps."""

    name: Literal["ppo"] = "ppo"
    max_gradient_norm: float = 0.5
    num_worlds: int = 256  # over all devices
    steps_per_update: int = 32  # in each world
    strata: int = 8  # equal parts of the worlds; the number of devices must divide it
    normalizes_values: bool = True  # by the moments of the latest returns
    num_pasts: int = 0  # past selves kept, to be met by the present one
    past_every: int = 100  # updates, after which the present self becomes a past one

    def __post_init__(self) -> None:
        """Checks the ranges, those of its parts included.

        Raises:
            ValueError: if a field is out of range, or strata do not divide a batch.
        """
        optim.OptimizerConfig.__post_init__(self)
        AppraisalConfig.__post_init__(self)
        RehearsalConfig.__post_init__(self)
        strata.check(self.strata, num_worlds=self.num_worlds)
        if self.imitation_weight:
            strata.check(self.strata, imitation_batch_size=self.imitation_batch_size)
        ranges.require_at_least(self, steps_per_update=1, past_every=1, num_pasts=0)

    @property
    def gradient_steps(self) -> float:
        """How many an update takes, unless it ends early."""
        return float(self.epochs * self.minibatches)

    @property
    def num_steps(self) -> int:
        """How many steps of worlds an update plays."""
        return self.num_worlds * self.steps_per_update


class Kept(Record):
    """What is remembered between updates, besides parameters."""

    normalizer: Normalizer
    pasts: Pasts | tuple[()]
    gradient_steps: Int[Array, ""]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Setting:
    """Who learns where, and how."""

    pupil: Pupil
    env_of: EnvironmentOf
    config: PPOConfig


class Seen(Record):
    """What a device gathered by acting."""

    study: Study
    told: Metrics  # how it went, with a leading axis of this device


def ppo(
    agent: Agent,
    env_of: EnvironmentOf,
    sample: Sample,
    optimizer: optim.Optimizer,
    config: PPOConfig,
) -> Learner:
    """Makes a learner that acts and improves on what turned out well.

    With the ratio r of an action's probabilities, new to old, its advantage A, the
    value V of target T, the entropy H, and weights c (Schulman et al. 2017, equations
    7 and 9; the last term is ours):

        loss = -mean min(r A, clip(r, 1 - e, 1 + e) A)
               + c_V mean (V - T)^2 / 2 - c_H mean H - c_I mean_expert log p(a)

    over all steps at which an actor acted: the ego in planning, in multi-agent all that
    the one team controls, who share parameters. An agent with memory goes through the
    steps of a world in a row; one without learns from single steps.

    Departs from the paper where the config says so: the critic learns normalized
    returns, and an update is over at the minibatch whose mean of (r - 1) - log r
    exceeds a limit, before its step.

    Args:
        agent: the policy and its critic.
        env_of: the task; `lambda past: env` if nobody in it is a past self.
        sample: draws one demonstration, for a config that imitates.
        optimizer: takes the steps.
        config: how much of all.

    Raises:
        ValueError: if minibatches would not get equal parts of each stratum, or one who
            remembers is to imitate.
    """
    _check_minibatches(agent, config)
    if config.imitation_weight:
        bc.require_no_memory(agent)
    pupil = Pupil(agent=agent, sample=sample, optimizer=optimizer, config=config)
    setting = Setting(pupil=pupil, env_of=env_of, config=config)
    return Learner(
        init=functools.partial(_init, setting),
        act=functools.partial(_act, setting),
        learn=functools.partial(_learn, setting),
        adopt=functools.partial(_adopt, config),
    )


def _init(
    setting: Setting, key: Key[Array, ""], bank: Bank, axis_name: str
) -> TrainState:
    config, pupil = setting.config, setting.pupil
    key, params_key, world_key = jax.random.split(key, 3)
    params = pupil.agent.init(params_key)
    past = _pasts(config, params)
    cast = Cast(setting.env_of(past), pupil.agent, sequences.explore)
    share = strata.share(config.strata, axis_name)
    per_stratum = config.num_worlds // config.strata
    return TrainState(
        params=params,
        opt_state=pupil.optimizer.transformation.init(params),
        step=jnp.zeros((), jnp.int32),
        key=key,
        kept=Kept(
            normalizer=normalizers.begin(),
            pasts=past,
            gradient_steps=jnp.zeros((), jnp.int32),
        ),
        worlds=stages.begin(cast, params, bank, share, world_key, per_stratum),
    )


def _act(
    setting: Setting, train_state: TrainState, bank: Bank, axis_name: str
) -> tuple[TrainState, Seen]:
    config = setting.config
    key, act_key = jax.random.split(train_state.key)
    params, past = train_state.params, train_state.kept.pasts
    share = strata.share(config.strata, axis_name)
    cast = Cast(setting.env_of(past), setting.pupil.agent, sequences.explore)
    stage, played, told = stages.play(
        cast, params, bank, share, act_key, train_state.worlds, config.steps_per_update
    )
    told |= stages.counts(played, axis_name)
    told = jax.tree.map(lambda leaf: leaf[None], told)
    seen = Seen(study=appraisal.study(cast, bank, played), told=told)
    return train_state.replace(key=key, worlds=stage), seen


def _learn(
    setting: Setting, train_state: TrainState, seen: Seen, bank: Bank, axis_name: str
) -> tuple[TrainState, Metrics]:
    config, agent = setting.config, setting.pupil.agent
    key, learn_key = jax.random.split(train_state.key)
    params, kept, study = train_state.params, train_state.kept, seen.study
    share = strata.share(config.strata, axis_name)
    told = jax.tree.map(lambda leaf: jax.lax.psum(leaf[0], axis_name), seen.told)
    worth = appraisal.appraise(config, agent, params, kept.normalizer, study)
    told["explained_variance"] = _explained(kept, study, worth, axis_name)
    if config.normalizes_values:
        # Before the critic learns: values that it has not learned as they are now
        # normalized would be what the next returns are told from.
        mask, target = study.sequence.mask, worth.target
        normalizer = normalizers.see(kept.normalizer, target, mask, axis_name)
        kept = kept.replace(normalizer=normalizer)

    lessons_of = _lessons(agent, config, kept.normalizer, study, worth, share)
    bare = train_state.replace(key=learn_key, step=kept.gradient_steps)
    bare = bare.replace(kept=(), worlds=())
    learned, metrics = rehearsal.rehearse(
        setting.pupil, bare, bank, share, lessons_of, axis_name
    )
    step = train_state.step + 1
    moved = learned.replace(
        key=key,
        step=step,
        kept=_keep(config, kept, learned, step),
        worlds=train_state.worlds,
    )
    return moved, told | metrics


def _adopt(config: PPOConfig, train_state: TrainState, params: Params) -> TrainState:
    kept = train_state.kept.replace(pasts=_pasts(config, params))
    return train_state.replace(params=params, kept=kept)


def _pasts(config: PPOConfig, params: Params) -> Pasts | tuple[()]:
    return pasts.begin(params, config.num_pasts) if config.num_pasts else ()


def _check_minibatches(agent: Agent, config: PPOConfig) -> None:
    num_units = config.num_worlds // config.strata
    if not agent.remembers:
        num_units *= config.steps_per_update
    if num_units % config.minibatches:
        raise ValueError(
            f"minibatches must divide the {num_units} "
            f"{'worlds' if agent.remembers else 'steps'} of each stratum, got "
            f"{config.minibatches}; set num_worlds or strata."
        )


def _explained(kept: Kept, study: Study, worth: Worth, axis_name: str) -> Mean:
    value = kept.normalizer.restore(study.sequence.note.value)
    mask = study.sequence.mask
    return appraisal.explained_variance(worth, value, mask, axis_name)


def _lessons(
    agent: Agent,
    config: PPOConfig,
    normalizer: Normalizer,
    study: Study,
    worth: Worth,
    share: strata.Share,
) -> rehearsal.LessonsOf:
    """Returns what gives the lessons of an epoch."""

    def cut(worth: Worth) -> Lesson:
        target = normalizer.normalize(worth.target)
        lesson = Lesson(sequence=study.sequence, worth=worth.replace(target=target))
        num_actors = study.sequence.mask.ndim - 2
        by_step = not agent.remembers
        return sequences.units(lesson, len(share.number), num_actors, by_step)

    first = cut(worth)

    def lessons(epoch: Int[Array, ""], params: Params) -> Lesson:
        if config.advantage == "gae":
            return first
        # Nobody has learned anything before the first.
        return jax.lax.cond(
            epoch == 0,
            lambda: first,
            lambda: cut(appraisal.reappraise(config, agent, params, normalizer, study)),
        )

    return lessons


def _keep(config: PPOConfig, kept: Kept, learned: TrainState, step: Array) -> Kept:
    """Returns what is remembered after an update, the `step`-th."""
    kept = kept.replace(gradient_steps=learned.step)
    if isinstance(kept.pasts, tuple):
        return kept
    wanted = step % config.past_every == 0
    return kept.replace(pasts=pasts.keep(kept.pasts, learned.params, wanted))
