"""Changes parameters along their gradients: Adam with clipping and a schedule."""

import dataclasses

import jax.numpy as jnp
import optax

from ..agents.base import Params
from .base import Metrics, TrainState


@dataclasses.dataclass(frozen=True, kw_only=True)
class OptimizerConfig:
    """How far each update goes."""

    learning_rate: float = 1e-4  # after the warm-up
    warmup_updates: int = 0  # with a rate growing linearly from zero
    decay_updates: int | None = None  # in all, along a cosine to zero; None: no decay
    max_gradient_norm: float = 10.0  # gradients longer than this are shortened to it


@dataclasses.dataclass(frozen=True, kw_only=True)
class Optimizer:
    """A gradient transformation and the learning rate it takes at each update."""

    transformation: optax.GradientTransformation
    learning_rate: optax.Schedule


def adam(config: OptimizerConfig) -> Optimizer:
    """Makes Adam (Kingma and Ba 2015) with global-norm clipping before it.

    Raises:
        ValueError: if a rate, norm or count is out of range.
    """
    if config.learning_rate <= 0 or config.max_gradient_norm <= 0:
        raise ValueError(
            f"learning_rate and max_gradient_norm must be positive, got "
            f"{config.learning_rate} and {config.max_gradient_norm}."
        )
    if config.warmup_updates < 0:
        raise ValueError(
            f"warmup_updates must not be negative, got {config.warmup_updates}."
        )
    if config.decay_updates is None:
        learning_rate = optax.warmup_constant_schedule(
            0.0 if config.warmup_updates else config.learning_rate,
            config.learning_rate,
            config.warmup_updates,
        )
    elif config.decay_updates > config.warmup_updates:
        learning_rate = optax.warmup_cosine_decay_schedule(
            0.0 if config.warmup_updates else config.learning_rate,
            config.learning_rate,
            config.warmup_updates,
            config.decay_updates,
        )
    else:
        raise ValueError(
            f"decay_updates counts the warm-up in and must exceed it, got "
            f"{config.decay_updates} with {config.warmup_updates} of warm-up."
        )
    transformation = optax.chain(
        optax.clip_by_global_norm(config.max_gradient_norm), optax.adam(learning_rate)
    )
    return Optimizer(transformation=transformation, learning_rate=learning_rate)


def descend(
    optimizer: Optimizer, train_state: TrainState, gradients: Params
) -> tuple[TrainState, Metrics]:
    """Takes one step against gradients that are already those of the whole batch.

    Returns:
        The train state with new parameters and one more step, and the metrics
        `gradient_norm` (before clipping) and `learning_rate`.
    """
    updates, opt_state = optimizer.transformation.update(
        gradients, train_state.opt_state, train_state.params
    )
    metrics = {
        "gradient_norm": optax.tree.norm(gradients),
        "learning_rate": jnp.asarray(
            optimizer.learning_rate(train_state.step), jnp.float32
        ),
    }
    moved = train_state.replace(
        params=optax.apply_updates(train_state.params, updates),
        opt_state=opt_state,
        step=train_state.step + 1,
    )
    return moved, metrics
