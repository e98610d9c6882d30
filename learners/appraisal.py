"""Judges by the critic what the steps of an unroll were worth."""

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..agents.base import Agent, Memory, Params
from ..sim import ranges
from ..sim.observations.base import Observation
from ..sim.records import Record
from . import normalizer as normalizers, returns, sequences
from .acting import Cast
from .base import Bank, Mean
from .normalizer import Normalizer
from .returns import Course, Worth
from .sequences import Sequence
from .stage import Played


@dataclasses.dataclass(frozen=True, kw_only=True)
class AppraisalConfig:
    """How advantages are estimated."""

    advantage: Literal["gae", "vtrace"] = "gae"  # vtrace: anew for each epoch
    discount: float = 0.99  # a step
    decay: float = 0.95  # lambda, of either

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a factor is not between 0 and 1.
        """
        ranges.require_share(self, "discount", "decay")


class Study(Record):
    """What an unroll gives to learn from, [worlds, *actors, ...]."""

    sequence: Sequence  # its values are normalized
    memory: Memory  # after the last step
    observation: Observation  # likewise


def study(cast: Cast, bank: Bank, played: Played) -> Study:
    """Returns what there is to learn from."""
    observe = jax.vmap(cast.env.observe, in_axes=(None, 0))
    return Study(
        sequence=sequences.of_actors(played),
        memory=played.after.memory,
        observation=observe(bank, played.after.state),
    )


def appraise(
    config: AppraisalConfig,
    agent: Agent,
    params: Params,
    normalizer: Normalizer,
    study: Study,
) -> Worth:
    """Returns what the steps were worth to those who took them.

    Args:
        config: the estimate.
        agent: of one actor.
        params: by which it acted.
        normalizer: of its values.
        study: of all actors.
    """

    def of_one(study: Study) -> Worth:
        value = study.sequence.note.value
        course = _course(config, agent, params, normalizer, study, value)
        if config.advantage == "gae":
            return returns.generalized_advantage(course, config.decay)
        return returns.vtrace(course, jnp.ones_like(course.reward), config.decay)

    return sequences.each(of_one, study.sequence.mask.ndim - 1)(study)


def reappraise(
    config: AppraisalConfig,
    agent: Agent,
    params: Params,
    normalizer: Normalizer,
    study: Study,
) -> Worth:
    """Returns by V-trace what the steps are worth to an agent that has learned since.

    Args:
        config: the estimate.
        agent: of one actor.
        params: those of today.
        normalizer: of its values.
        study: of all actors.
    """

    def of_one(study: Study) -> Worth:
        output, log_ratio = sequences.recall(agent, params, study.sequence)
        course = _course(config, agent, params, normalizer, study, output.value)
        return returns.vtrace(course, jnp.exp(log_ratio), config.decay)

    return sequences.each(of_one, study.sequence.mask.ndim - 1)(study)


def explained_variance(
    worth: Worth, value: Float[Array, "*batch"], mask: Array, axis_name: str
) -> Mean:
    """Returns which part of the variance of targets T the values V tell beforehand.

    It is 1 - Var(T - V) / Var(T): 1 for a perfect critic, 0 for a constant one.
    """
    _, _, total = normalizers.moments(worth.target, mask, axis_name)
    _, _, rest = normalizers.moments(worth.target - value, mask, axis_name)
    return Mean(total=jnp.where(total > 0, total - rest, 0.0), weight=total)


def _course(
    config: AppraisalConfig,
    agent: Agent,
    params: Params,
    normalizer: Normalizer,
    study: Study,
    value: Float[Array, " steps"],
) -> Course:
    _, output = agent.step(params, study.memory, study.observation)
    return Course(
        reward=study.sequence.reward,
        discount=config.discount * study.sequence.discount,
        value=normalizer.restore(jnp.append(value, output.value)),
        mask=study.sequence.mask,
    )
