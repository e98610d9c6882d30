"""Changes parameters along their gradients: Adam with clipping and a schedule."""

import dataclasses
import math

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

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a rate, norm or count is out of range.
        """
        if not (0 < self.learning_rate < math.inf and self.max_gradient_norm > 0):
            raise ValueError(
                f"learning_rate and max_gradient_norm must be positive, got "
                f"{self.learning_rate} and {self.max_gradient_norm}."
            )
        if self.warmup_updates < 0:
            raise ValueError(
                f"warmup_updates must not be negative, got {self.warmup_updates}."
            )
        if self.decay_updates is not None and (
            self.decay_updates <= self.warmup_updates
        ):
            raise ValueError(
                f"decay_updates counts the warm-up in and must exceed it, got "
                f"{self.decay_updates} with {self.warmup_updates} of warm-up."
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Optimizer:
    """A gradient transformation and the learning rate it takes at each update."""

    transformation: optax.GradientTransformation
    learning_rate: optax.Schedule


def adam(config: OptimizerConfig) -> Optimizer:
    """Makes Adam (Kingma and Ba 2015) with global-norm clipping before it."""
    if config.decay_updates is None:
        learning_rate = optax.warmup_constant_schedule(
            0.0 if config.warmup_updates else config.learning_rate,
            config.learning_rate,
            config.warmup_updates,
        )
    else:
        learning_rate = optax.warmup_cosine_decay_schedule(
            0.0 if config.warmup_updates else config.learning_rate,
            config.learning_rate,
            config.warmup_updates,
            config.decay_updates,
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
