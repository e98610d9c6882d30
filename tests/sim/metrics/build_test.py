"""Tests that what is asked for is measured, and what every metric must hold."""

import jax
import numpy as np
import pytest

from drivetrain.sim.metrics.base import Measure, Metric, Moment
from drivetrain.sim.metrics.build import EGO, METRICS, measure_all, measure_ego
from drivetrain.sim.metrics.collision import COLLISION
from drivetrain.sim.metrics.goal import GOAL
from tests import worlds

ROUNDING = 1e-4  # programs of other shapes round metres otherwise


@jax.jit
def of_the_ego(moment: Moment) -> dict[str, Measure]:
    """Returns all metrics of the ego."""
    return measure_ego(moment)


@pytest.mark.parametrize("measure", [measure_ego, measure_all])
def test_only_what_is_asked_for_is_measured(measure) -> None:
    moment = worlds.samples("generated")[0].moment
    measured = jax.eval_shape(lambda: measure(moment, (COLLISION, GOAL)))
    assert set(measured) == {"collision", "goal"}


def test_names_tell_metrics_apart() -> None:
    assert len({metric.name for metric in METRICS}) == len(METRICS)


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_the_ego_alone_is_measured_as_among_all(metric: Metric) -> None:
    for sample in worlds.samples("generated"):
        alone = of_the_ego(sample.moment)[metric.name]
        among = sample.measures[metric.name]
        if not metric.ego_only:
            among = jax.tree.map(lambda leaf: leaf[EGO], among)
        assert alone.valid == among.valid
        np.testing.assert_allclose(alone.value, among.value, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_who_is_absent_is_not_measured(metric: Metric) -> None:
    moment = worlds.samples("generated")[0].moment
    absent = moment.after.valid.at[EGO].set(False)
    gone = worlds.filled(moment.after.replace(valid=absent), 3.0)
    assert not of_the_ego(moment.replace(after=gone))[metric.name].valid


def test_nothing_is_measured_twice_in_a_step() -> None:
    moment = worlds.samples("generated")[0].moment

    def flops(*names: str) -> float:
        metrics = [metric for metric in METRICS if metric.name in names]
        program = jax.jit(lambda moment: measure_ego(moment, metrics))
        return program.lower(moment).compile().cost_analysis()["flops"]

    routes = [metric.name for metric in METRICS if metric.ego_only]
    assert len(routes) == 5
    # The paths are searched once; five searches would be five times the work.
    assert flops(*routes) < 2 * flops("progress")
