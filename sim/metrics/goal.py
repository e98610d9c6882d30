"""Tells whether an object is at its goal (N 3.1)."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Int

from .base import Measure, Metric, Moment


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalConfig:
    """When a goal counts as reached; None leaves a condition out (N app. C)."""

    position: float = 1.0  # metres
    speed: float | None = 1.0  # metres per second
    heading: float | None = 0.3  # radians

    def __post_init__(self) -> None:
        """Checks the tolerances.

        Raises:
            ValueError: if one is not positive.
        """
        for field in dataclasses.fields(self):
            tolerance = getattr(self, field.name)
            if tolerance is not None and not tolerance > 0:
                raise ValueError(
                    f"the goal's {field.name} tolerance must be above 0, got "
                    f"{tolerance}; None leaves the condition out."
                )


def goal_reached(config: GoalConfig) -> Metric:
    """Builds the metric.

    Args:
        config: the tolerances.

    Returns:
        The metric that is 1 where the object is nearer to its goal than each of them.
        Valid where the object is there and has a goal.
    """

    def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
        gap = moment.goal.gap(moment.after, number)
        reached = gap.distance < config.position
        if config.speed is not None:
            reached &= gap.speed < config.speed
        if config.heading is not None:
            reached &= gap.heading < config.heading
        valid = moment.after.valid[number] & moment.goal.motion.valid[number]
        return Measure(value=(reached & valid).astype(jnp.float32), valid=valid)

    return Metric("goal", False, measure)


GOAL = goal_reached(GoalConfig())
