"""Goes over what was done several times, in minibatches: the learning part of PPO."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, Key

from ..agents.base import Agent, Output, Params
from ..sim import pytrees, ranges
from ..sim.env.demonstrations import Demonstration, Sample
from ..sim.records import Record
from . import bc, losses, minibatches, normalizer, optim, sequences, strata, surrogate
from .base import Bank, Metrics, TrainState, one
from .returns import Worth
from .sequences import Sequence

LEAST_DEVIATION = 1e-8  # advantages that differ by less stay small


@dataclasses.dataclass(frozen=True, kw_only=True)
class RehearsalConfig:
    """How much is made of what was done."""

    epochs: int = 4
    minibatches: int = 4  # an epoch
    clip: float = 0.2  # how far a ratio may be from 1
    value_weight: float = 0.5
    entropy_weight: float = 0.001
    kl_limit: float | None = None  # nats; beyond it the rest of the update is skipped
    normalizes_advantages: bool = True  # over each minibatch
    imitation_weight: float = 0.0  # of the surprise at what the expert does
    imitation_batch_size: int = 256  # demonstrations a minibatch, over all devices

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a count, weight or limit is out of range.
        """
        ranges.require_at_least(self, epochs=1, minibatches=1, imitation_batch_size=1)
        ranges.require_finite(
            self, "value_weight", "entropy_weight", "imitation_weight"
        )
        for name in ("clip", "kl_limit"):
            if getattr(self, name) is not None and not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}.")


class Lesson(Record):
    """What to learn from one sequence."""

    sequence: Sequence
    worth: Worth  # its targets are normalized, as the critic's values are


# Of the number of an epoch and the parameters at its start: what there is to learn,
# [strata, units, *actors, ...].
LessonsOf = Callable[[Int[Array, ""], Params], Lesson]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pupil:
    """Who learns, and how."""

    agent: Agent
    sample: Sample  # of what the expert does
    optimizer: optim.Optimizer
    config: RehearsalConfig


def rehearse(
    pupil: Pupil,
    train_state: TrainState,
    bank: Bank,
    share: strata.Share,
    lessons_of: LessonsOf,
    axis_name: str,
) -> tuple[TrainState, Metrics]:
    """Takes a step for each minibatch of each epoch, as long as the policy stays near.

    Args:
        pupil: who learns.
        train_state: before.
        bank: of scenarios, for demonstrations.
        share: the strata of this device.
        lessons_of: what there is to learn in an epoch.
        axis_name: of the devices.

    Returns:
        The train state with new parameters, and metrics: the terms of the loss, those
        of `optim.descend`, and `skipped`, the part of the minibatches whose step was
        not taken.
    """
    config = pupil.config

    def epoch(carry, own):
        number, key = own
        order_key, steps_key = jax.random.split(key)
        lessons = lessons_of(number, carry[0].params)
        num_units = lessons.sequence.mask.shape[1]
        dealt = minibatches.deal(share, order_key, num_units, config.minibatches)

        def minibatch(carry, own):
            train_state, goes_on = carry
            units, key = own
            batch = minibatches.take(lessons, units)
            moved, metrics = _step(
                pupil, train_state, bank, share, batch, key, axis_name
            )
            return _unless_far(config, train_state, goes_on, moved, metrics)

        keys = jax.random.split(steps_key, config.minibatches)
        return jax.lax.scan(minibatch, carry, (dealt, keys))

    key, epochs_key = jax.random.split(train_state.key)
    keys = jax.random.split(epochs_key, config.epochs)
    begun = train_state.replace(key=key), jnp.bool_(True)
    numbers = jnp.arange(config.epochs)
    (train_state, _), metrics = jax.lax.scan(epoch, begun, (numbers, keys))
    return train_state, jax.tree.map(jnp.sum, metrics)


def _unless_far(
    config: RehearsalConfig,
    before: TrainState,
    goes_on: Bool[Array, ""],
    moved: TrainState,
    metrics: Metrics,
) -> tuple[tuple[TrainState, Bool[Array, ""]], Metrics]:
    """Takes a step unless the policy is too far from that which acted, or was before.

    The metrics of a minibatch count if it was looked at.
    """
    if config.kl_limit is None:
        return (moved, goes_on), metrics | {"skipped": one(0.0)}
    divergence = metrics["kl"].total / jnp.maximum(metrics["kl"].weight, 1.0)
    # What is no number is not skipped: it has to be seen.
    taken = goes_on & ~(divergence > config.kl_limit)
    counted = {
        name: jax.tree.map(lambda leaf: jnp.where(goes_on, leaf, 0.0), metric)
        for name, metric in metrics.items()
    }
    after = pytrees.where(taken, moved, before)
    return (after, taken), counted | {"skipped": one(~taken)}


def _step(
    pupil: Pupil,
    train_state: TrainState,
    bank: Bank,
    share: strata.Share,
    batch: Lesson,
    key: Key[Array, ""],
    axis_name: str,
) -> tuple[TrainState, Metrics]:
    """Takes the step of one minibatch."""
    config, mask = pupil.config, batch.sequence.mask
    noise_key, expert_key = jax.random.split(key)
    split = jax.vmap(jax.random.split, in_axes=(0, None))
    keys = split(share.keys(noise_key), mask.shape[1:])
    if config.normalizes_advantages:
        advantage = _standard(batch.worth.advantage, mask, axis_name)
        batch = batch.replace(worth=batch.worth.replace(advantage=advantage))
    # In one row, whatever stratum, unit and actor they are of.
    batch, keys = jax.tree.map(
        lambda leaf: leaf.reshape(-1, *leaf.shape[mask.ndim - 1 :]), (batch, keys)
    )
    demonstrations = None
    if config.imitation_weight:
        num_strata = len(share.number) * jax.lax.axis_size(axis_name)
        per_stratum = config.imitation_batch_size // num_strata
        demonstrations = bc.draw(pupil.sample, bank, share, expert_key, per_stratum)

    def loss(params: Params) -> tuple[Metrics, None]:
        return _loss(pupil, params, batch, keys, demonstrations, axis_name), None

    moved, metrics, _ = optim.descend(pupil.optimizer, train_state, axis_name, loss)
    return moved, metrics


def _loss(
    pupil: Pupil,
    params: Params,
    batch: Lesson,
    keys: Key[Array, "sequences steps"],
    demonstrations: Demonstration | None,
    axis_name: str,
) -> Metrics:
    """Returns the loss of a minibatch, [sequences, steps, ...], and its terms."""
    config, weight = pupil.config, batch.sequence.mask.astype(jnp.float32)
    judge = jax.vmap(terms, in_axes=(None, None, None, 0, 0))
    found = judge(pupil.agent, config.clip, params, batch, keys)
    means = {name: losses.weighted(term, weight) for name, term in found.items()}
    parts = [
        (1.0, means["policy_loss"]),
        (config.value_weight, means["value_loss"]),
        (-config.entropy_weight, means["entropy"]),
    ]
    if demonstrations is not None:
        imitation = bc.imitation(pupil.agent, params, demonstrations)
        means |= {f"imitation/{name}": mean for name, mean in imitation.items()}
        parts.append((config.imitation_weight, imitation["loss"]))
    return means | {"loss": losses.combine(parts, axis_name)}


def terms(
    agent: Agent,
    clip: float,
    params: Params,
    lesson: Lesson,
    keys: Key[Array, " steps"],
) -> dict[str, Array]:
    """Returns the terms of PPO's loss at each step of a sequence."""
    output, log_ratio = sequences.recall(agent, params, lesson.sequence)

    def entropy(output: Output, key: Key[Array, ""]) -> Array:
        return sequences.distribution(output).entropy(key)

    return {
        "policy_loss": -surrogate.clipped(log_ratio, lesson.worth.advantage, clip),
        "value_loss": (output.value - lesson.worth.target) ** 2 / 2,
        "entropy": jax.vmap(entropy)(output, keys),
        "kl": surrogate.divergence(log_ratio),
        "clipped": surrogate.is_clipped(log_ratio, clip).astype(jnp.float32),
    }


def _standard(advantage: Array, mask: Bool[Array, "*batch"], axis_name: str) -> Array:
    """Gives the advantages of a minibatch the mean 0 and the deviation 1."""
    count, mean, squares = normalizer.moments(advantage, mask, axis_name)
    deviation = jnp.sqrt(squares / jnp.maximum(count, 1.0))
    return (advantage - mean) / (deviation + LEAST_DEVIATION)
