"""Knows all metrics."""

import jax
import jax.numpy as jnp

from .base import Measure, Metric, Moment
from .collision import COLLISION
from .displacement import DISPLACEMENT
from .kinematics import KINEMATIC
from .offroad import OFFROAD
from .route import OFF_ROUTE, PROGRESS, ROUTE_DISTANCE

METRICS: tuple[Metric, ...] = (
    COLLISION,
    OFFROAD,
    KINEMATIC,
    DISPLACEMENT,
    PROGRESS,
    OFF_ROUTE,
    ROUTE_DISTANCE,
)
EGO = 0  # the bank puts the ego first


def measure_ego(moment: Moment) -> dict[str, Measure]:
    """Returns each metric of the ego."""
    ego = jnp.int32(EGO)
    return {metric.name: metric.measure(moment, ego) for metric in METRICS}


def measure_all(moment: Moment) -> dict[str, Measure]:
    """Returns each metric of all objects, and of the ego where it is about routes."""
    numbers = jnp.arange(len(moment.after.valid))
    return {
        metric.name: metric.measure(moment, jnp.int32(EGO))
        if metric.ego_only
        else jax.vmap(metric.measure, in_axes=(None, 0))(moment, numbers)
        for metric in METRICS
    }
