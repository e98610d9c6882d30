"""Changes parameters along their gradients: Adam with clipping and a schedule."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array

from ..agents.base import Params
from ..sim import names
from . import strata
from .base import Metrics, TrainState, one

# Of the parameters and whatever else: means over the device's share, among them `loss`,
# and what else is wanted of it.
Loss = Callable[..., tuple[Metrics, Any]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class OptimizerConfig:
    """How far each update goes."""

    learning_rate: float = 1e-4  # after the warm-up
    warmup_updates: int = 0  # with a rate growing linearly from zero
    decay_updates: int | None = None  # in all, along a cosine to zero; None: no decay
    max_gradient_norm: float = 10.0  # gradients longer than this are shortened to it
    # Of parts of the parameters, such as encoder or encoder/tokens, the multiple of the
    # learning rate; 0 freezes a part. The longest name that fits a parameter decides.
    part_rates: dict[str, float] = dataclasses.field(default_factory=dict)

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
        for part, rate in self.part_rates.items():
            if not 0 <= rate < math.inf:
                raise ValueError(
                    f"part_rates must be at least 0 and finite, got {rate} for {part}."
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

    @property
    def gradient_steps(self) -> float:
        """How many an update of the learner takes, one unless it says otherwise."""
        return 1.0


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
        _scaled({part: float(rate > 0) for part, rate in config.part_rates.items()}),
        optax.clip_by_global_norm(config.max_gradient_norm),
        optax.adam(learning_rate),
        _scaled(config.part_rates),
    )
    return Optimizer(transformation=transformation, learning_rate=learning_rate)


def _scaled(rates: Mapping[str, float]) -> optax.GradientTransformation:
    """Scales the parts of an update; what no rate names stays as it is."""
    if not rates:
        return optax.identity()

    def names_of(path: tuple[Any, ...]) -> list[str]:
        name = jax.tree_util.keystr(path, simple=True, separator="/")
        return [part for part in rates if f"{name}/".startswith(f"{part}/")]

    def init(params: Params) -> optax.EmptyState:
        paths, _ = jax.tree_util.tree_flatten_with_path(params)
        used = {part for path, _ in paths for part in names_of(path)}
        for part in rates:
            if part not in used:
                raise names.unknown("part in part_rates", part, sorted(params))
        return optax.EmptyState()

    def update(updates: Any, state: Any, params: Any = None) -> tuple[Any, Any]:
        del params

        def scale(path: tuple[Any, ...], leaf: Array) -> Array:
            fitting = names_of(path)
            return leaf * rates[max(fitting, key=len)] if fitting else leaf

        return jax.tree_util.tree_map_with_path(scale, updates), state

    return optax.GradientTransformation(init, update)


def descend(
    optimizer: Optimizer,
    train_state: TrainState,
    axis_name: str,
    loss: Loss,
    *arguments: Any,
) -> tuple[TrainState, Metrics, Any]:
    """Takes one step down the loss over the shares of all devices together.

    The loss is the quotient of its sums over all devices, so a device with more weight
    counts more.

    Args:
        optimizer: takes the step.
        train_state: before it.
        axis_name: of the devices.
        loss: of the parameters and the arguments.
        *arguments: this device's.

    Returns:
        The train state with new parameters and one more step, the metrics of the loss
        with those of the step, `gradient_norm` (before clipping and freezing, and that
        of each part of the parameters) and `learning_rate`, and what else the loss
        returns.
    """

    def total(params: Params) -> tuple[Array, tuple[Metrics, Any]]:
        metrics, extra = loss(params, *arguments)
        return metrics["loss"].total, (metrics, extra)

    # Parameters marked as each device's own get that device's own gradient; without
    # the mark jax.grad would sum over devices, and the sum below would count twice.
    params = strata.own(train_state.params, axis_name)
    gradients, (metrics, extra) = jax.grad(total, has_aux=True)(params)
    gradients, metrics = jax.lax.psum((gradients, metrics), axis_name)
    weight = metrics["loss"].weight
    divisor = jnp.where(weight > 0, weight, 1.0)
    gradients = jax.tree.map(lambda leaf: leaf / divisor, gradients)

    updates, opt_state = optimizer.transformation.update(
        gradients, train_state.opt_state, train_state.params
    )
    moved = train_state.replace(
        params=optax.apply_updates(train_state.params, updates),
        opt_state=opt_state,
        step=train_state.step + 1,
    )
    rate = optimizer.learning_rate(train_state.step)
    return moved, metrics | _norms(gradients) | {"learning_rate": one(rate)}, extra


def _norms(gradients: Params) -> Metrics:
    norms = {"gradient_norm": one(optax.tree.norm(gradients))}
    if isinstance(gradients, dict):
        for part, leaves in sorted(gradients.items()):
            norms[f"gradient_norm/{part}"] = one(optax.tree.norm(leaves))
    return norms
