"""Tests who is at its goal against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.metrics.base import Measure, Moment
from drivetrain.sim.metrics.goal import GoalConfig, goal_reached
from drivetrain.sim.motion import Motion
from drivetrain.sim.scenario import Scenario
from tests import worlds
from tests.oracles import dynamics, metrics as oracle

CONFIGS = {
    "all": GoalConfig(),
    "without speed": GoalConfig(speed=None),
    "without heading": GoalConfig(heading=None),
    "place alone": GoalConfig(position=0.6, speed=None, heading=None),
}
# Tolerances vary by this share: float32 at 100 m and some metres per second.
NEAR = 1e-3


def near_goals(moment: Moment, seed: int) -> Moment:
    """Moves everybody to near its goal, a tenth backwards."""
    rng = np.random.default_rng(seed)
    goal, num_objects = moment.goal.motion, len(moment.after.valid)
    scale = rng.uniform(0, 1.5, (num_objects, 1))
    turn = scale[:, 0] * rng.normal(0, 0.2, num_objects)
    turn += 2 * np.pi * rng.integers(-1, 2, num_objects)
    backwards = np.where(rng.random((num_objects, 1)) < 0.1, -1, 1)
    moved = Motion(
        xyz=goal.xyz + scale * rng.normal(0, 0.6, (num_objects, 3)),
        yaw=goal.yaw + turn,
        velocity=backwards * goal.velocity + rng.normal(0, 0.5, (num_objects, 2)),
        valid=moment.after.valid,
    )
    return moment.replace(after=worlds.filled(moved, 0.0))


def states(motion: Motion) -> list[dynamics.State]:
    """Returns the states of objects in float64."""
    columns = np.column_stack([motion.xy, motion.yaw, motion.velocity])
    return [dynamics.State(*row) for row in np.float64(columns).tolist()]


def logged_ends(scenario: Scenario, num_objects: int) -> list[dynamics.State]:
    """Returns the last valid logged state of the objects that the bank keeps."""
    tracks, found = scenario.tracks, []
    for i in worlds.order_of(scenario, num_objects):
        last = int(np.flatnonzero(tracks.valid[i])[-1])
        xy = (tracks.xyz[i, last] - scenario.origin)[:2]
        found.append(
            dynamics.State(*xy, float(tracks.yaw[i, last]), *tracks.velocity[i, last])
        )
    return found


@pytest.mark.parametrize("name", CONFIGS)
@pytest.mark.parametrize("kind", worlds.KINDS)
def test_goals_are_reached_where_the_oracle_says(kind: str, name: str) -> None:
    config, verdicts = CONFIGS[name], []
    metric = goal_reached(config)

    @jax.jit
    def measured(moment: Moment) -> Measure:
        numbers = jnp.arange(len(moment.after.valid))
        return jax.vmap(metric.measure, in_axes=(None, 0))(moment, numbers)

    limits = (config.position, config.speed, config.heading)
    strict, lax = (
        [None if limit is None else limit * share for limit in limits]
        for share in (1 - NEAR, 1 + NEAR)
    )
    for seed, sample in enumerate(worlds.samples(kind)):
        moment = near_goals(sample.moment, seed)
        found = measured(moment)
        valid = np.asarray(moment.after.valid)
        np.testing.assert_array_equal(found.valid, valid)
        assert not np.any(found.value[~valid])
        goals = logged_ends(sample.scenario, len(valid))
        here = states(moment.after)
        for i in np.flatnonzero(valid):
            reached = bool(found.value[i] > 0)
            assert oracle.goal_reached(here[i], goals[i], *strict) <= reached
            assert reached <= oracle.goal_reached(here[i], goals[i], *lax)
            verdicts.append(reached)
    assert 0.05 < np.mean(verdicts) < 0.98  # else the samples prove nothing


def test_who_has_no_goal_reaches_none() -> None:
    moment = worlds.samples("generated")[0].moment
    nobody = jnp.zeros_like(moment.goal.motion.valid)
    goal = moment.goal.replace(motion=moment.after.replace(valid=nobody))
    measured = worlds.measure(moment.replace(goal=goal))["goal"]
    assert not np.any(measured.valid)
    np.testing.assert_array_equal(measured.value, 0)


@pytest.mark.parametrize("name", ["position", "speed", "heading"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_tolerance_that_nothing_meets_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} tolerance must be above 0"):
        GoalConfig(**{name: value})
