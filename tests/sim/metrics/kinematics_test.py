"""Tests which moves are infeasible against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import geometry
from drivetrain.sim.dynamics import bicycle
from drivetrain.sim.metrics import kinematics
from tests import changes, worlds
from tests.oracles import dynamics, metrics as oracle

SLACK = (kinematics.ACCELERATION_SLACK, kinematics.CURVATURE_SLACK)
NEAR_LIMIT = 5e-4  # of float32: less than the slack, and around each threshold
DT = 0.1


def state(motion, i: int) -> dynamics.State:
    """Returns one object in float64."""
    return dynamics.State(
        *np.float64(motion.xy[i]), float(motion.yaw[i]), *np.float64(motion.velocity[i])
    )


def verdicts(before: dynamics.State, after: dynamics.State) -> set[bool]:
    """Returns what the oracle says with all thresholds a little lower and higher."""
    return {
        oracle.kinematic_infeasibility(
            before, after, DT, (SLACK[0] + shift, SLACK[1] + shift)
        )
        for shift in (-NEAR_LIMIT, NEAR_LIMIT)
    }


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_verdicts_are_those_of_the_oracle(kind: str) -> None:
    found = []
    for _, moment, measures in worlds.samples(kind):
        measured = measures["kinematic"]
        both = np.asarray(moment.before.valid & moment.after.valid)
        np.testing.assert_array_equal(measured.valid, both)
        flagged = np.asarray(measured.value) > 0
        assert not flagged[~both].any()
        for i in np.flatnonzero(both):
            expected = verdicts(state(moment.before, i), state(moment.after, i))
            assert bool(flagged[i]) in expected
            found.append(flagged[i])
    assert 0.1 < np.mean(found) < 0.95  # else the samples prove nothing


@pytest.mark.parametrize("excess", [-0.01, 0.01])
def test_the_limits_hold_to_a_hundredth(excess: float) -> None:
    moment = worlds.samples("generated")[0].moment
    before = moment.before.replace(
        velocity=10
        * jnp.stack([jnp.cos(moment.before.yaw), jnp.sin(moment.before.yaw)], -1),
        valid=jnp.ones_like(moment.before.valid),
    )
    limit = jnp.array([bicycle.MAX_ACCELERATION, 0.0])
    after = bicycle.forward(
        before, worlds.car_size(before), jnp.tile(limit, (len(before.yaw), 1)), DT
    )
    speed = after.speed + excess * DT
    faster = after.replace(velocity=after.velocity * (speed / after.speed)[:, None])
    measures = worlds.measure(moment.replace(before=before, after=faster))
    np.testing.assert_array_equal(measures["kinematic"].value, float(excess > 0))


def test_all_that_the_bicycle_does_is_feasible() -> None:
    rng = np.random.default_rng(0)
    limits = (bicycle.MAX_ACCELERATION, bicycle.MAX_CURVATURE)
    for _, moment, _ in worlds.samples("generated"):
        heading = jnp.stack(
            [jnp.cos(moment.before.yaw), jnp.sin(moment.before.yaw)], -1
        )
        rolling = moment.before.replace(velocity=moment.before.speed[:, None] * heading)
        action = rng.choice([-1.0, 1.0], (len(heading), 2)) * limits
        after = bicycle.forward(
            rolling, worlds.car_size(rolling), jnp.asarray(action, jnp.float32), DT
        )
        measures = worlds.measure(moment.replace(before=rolling, after=after))
        np.testing.assert_array_equal(measures["kinematic"].value, 0)


@pytest.mark.parametrize(
    ("course_before", "course_after", "flag"),
    [
        (0.0, 0.0, 0),
        (0.1, 0.2, 0),  # slips: the pose does not turn
        (np.pi, np.pi, 0),  # reverses
        (0.0, np.pi, 1),  # from 5 m/s forwards to 5 m/s backwards
    ],
)
def test_the_pose_tells_the_turn_and_the_sign_of_the_speed(
    course_before: float, course_after: float, flag: int
) -> None:
    moment = worlds.samples("generated")[0].moment
    there = moment.after.replace(valid=jnp.ones_like(moment.after.valid))
    before, after = (
        there.replace(velocity=5.0 * geometry.direction(there.yaw + course))
        for course in (course_before, course_after)
    )
    measures = worlds.measure(moment.replace(before=before, after=after))
    np.testing.assert_array_equal(measures["kinematic"].value, flag)


def test_nothing_is_undefined_at_rest() -> None:
    moment = worlds.samples("generated")[0].moment
    rest = jax.tree.map(jnp.zeros_like, moment.before).replace(
        valid=moment.before.valid
    )
    measures = worlds.measure(moment.replace(before=rest, after=rest))
    np.testing.assert_array_equal(measures["kinematic"].value, 0)


@pytest.mark.parametrize("change", changes.CHANGES)
def test_verdicts_are_kept(change: str) -> None:
    changes.assert_kept(change, "kinematic", 0)
