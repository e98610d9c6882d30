"""Knows all metrics."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from .base import Measure, Metric, Moment
from .collision import COLLISION
from .displacement import DISPLACEMENT
from .edge_contact import EDGE_CONTACT
from .goal import GOAL
from .kinematics import KINEMATIC
from .offroad import OFFROAD
from .red_light import RED_LIGHT
from .route import OFF_ROUTE, PROGRESS, ROUTE_DISTANCE
from .wrong_way import PATH_DISTANCE, WRONG_WAY

METRICS: tuple[Metric, ...] = (
    COLLISION,
    OFFROAD,
    EDGE_CONTACT,
    RED_LIGHT,
    GOAL,
    KINEMATIC,
    DISPLACEMENT,
    PROGRESS,
    OFF_ROUTE,
    ROUTE_DISTANCE,
    WRONG_WAY,
    PATH_DISTANCE,
)
EGO = 0  # the bank puts the ego first


def measure_ego(
    moment: Moment, metrics: Sequence[Metric] = METRICS
) -> dict[str, Measure]:
    """Returns metrics of the ego, by name."""
    ego = jnp.int32(EGO)
    return {metric.name: metric.measure(moment, ego) for metric in metrics}


def measure_all(
    moment: Moment, metrics: Sequence[Metric] = METRICS
) -> dict[str, Measure]:
    """Returns metrics of all objects, by name; of the ego where they need its paths."""
    numbers = jnp.arange(len(moment.after.valid))
    return {
        metric.name: metric.measure(moment, jnp.int32(EGO))
        if metric.ego_only
        else jax.vmap(metric.measure, in_axes=(None, 0))(moment, numbers)
        for metric in metrics
    }
