"""Tests of the oracle of the dynamics by numbers worked by hand."""

import math

import numpy as np
import pytest

from tests.oracles import dynamics
from tests.oracles.dynamics import State

ROUNDING = 1e-12  # float64, a few operations on numbers up to 100
QUARTER = math.pi / 2
MOVING = 0.6  # metres per second


def test_local_delta_is_in_the_frame_of_the_object() -> None:
    moved = dynamics.delta_forward(
        State(1, 2, QUARTER, 0, 0), 0.5, 0.25, 2.0, 0.1, local=True
    )
    expected = (0.75, 2.5, QUARTER + 2 - 2 * math.pi, -2.5, 5.0)
    np.testing.assert_allclose(moved, expected, atol=ROUNDING)


def test_global_delta_is_in_the_frame_of_the_map() -> None:
    moved = dynamics.delta_forward(
        State(1, 2, QUARTER, 9, 9), 0.5, 0.25, -2.0, 0.1, local=False
    )
    np.testing.assert_allclose(moved, (1.5, 2.25, QUARTER - 2, 5.0, 2.5), atol=ROUNDING)


@pytest.mark.parametrize("local", [True, False])
def test_delta_inverse_undoes_forward(local: bool) -> None:
    before = State(3, -4, 3.0, 1, 1)
    after = dynamics.delta_forward(before, 0.7, -0.2, 0.4, 0.1, local=local)
    action = dynamics.delta_inverse(before, after, local=local)
    np.testing.assert_allclose(action, (0.7, -0.2, 0.4), atol=ROUNDING)


def test_bicycle_by_hand() -> None:
    # d = 10 * 0.1 + 2 * 0.01 / 2 = 1.01 m, which turns by 0.101 rad.
    moved = dynamics.bicycle_forward(State(1, 2, 0, 10, 0), 2.0, 0.1, 0.1)
    expected = (2.01, 2, 0.101, 10.2 * math.cos(0.101), 10.2 * math.sin(0.101))
    np.testing.assert_allclose(moved, expected, atol=ROUNDING)


def test_bicycle_by_hand_in_reverse() -> None:
    # d = -10 * 0.1 + 2 * 0.01 / 2 = -0.99 m, which turns by -0.099 rad.
    before = State(1, 2, 0, -10, 0)
    moved = dynamics.bicycle_forward(before, 2.0, 0.1, 0.1)
    expected = (0.01, 2, -0.099, -9.8 * math.cos(0.099), 9.8 * math.sin(0.099))
    np.testing.assert_allclose(moved, expected, atol=ROUNDING)
    inverse = dynamics.bicycle_inverse(before, moved, 0.1, MOVING)
    np.testing.assert_allclose(inverse, (2, 0.1), atol=100 * ROUNDING)


def test_bicycle_brakes_past_zero_into_reverse() -> None:
    state = State(0, 0, 0, 0.3, 0)
    for speed in (-0.3, -0.9):
        state = dynamics.bicycle_forward(state, -6.0, 0.0, 0.1)
        assert state.vx == pytest.approx(speed, abs=ROUNDING)


@pytest.mark.parametrize("direction", [1, -1])
def test_kinematic_bicycle_by_hand(direction: int) -> None:
    # tan s = 1, so tan beta = 1 / 2; u = 10.1 m/s over a car of 4 m.
    before = State(1, 2, 0, direction * 10, 0)
    acceleration = direction * 2.0
    moved = dynamics.kinematic_bicycle_forward(
        before, 4.0, acceleration, math.pi / 4, 0.1
    )
    cos, sin = 2 / math.sqrt(5), 1 / math.sqrt(5)
    yaw, speed = direction * 1.01 * cos / 4, direction * 10.2
    expected = (
        1 + direction * 1.01 * cos,
        2 + direction * 1.01 * sin,
        yaw,
        speed * math.cos(yaw),
        speed * math.sin(yaw),
    )
    np.testing.assert_allclose(moved, expected, atol=ROUNDING)
    inverse = dynamics.kinematic_bicycle_inverse(before, moved, 4.0, 0.1)
    np.testing.assert_allclose(
        inverse, (acceleration, math.pi / 4), atol=100 * ROUNDING
    )


def test_kinematic_bicycle_has_no_steering_for_what_turns_too_tight() -> None:
    # C = 2 * 4 * 2 / 8 = 2 for a car of 4 m that turns by 0.2 rad at 4 m/s.
    before, after = State(0, 0, 0, 4, 0), State(0, 0, 0.2001, 4, 0)
    assert math.isnan(dynamics.kinematic_bicycle_inverse(before, after, 4.0, 0.1)[1])
    standing = State(0, 0, 0, 0, 0)
    _, steering = dynamics.kinematic_bicycle_inverse(standing, standing, 4.0, 0.1)
    assert math.isnan(steering)


def test_bicycle_moves_with_its_velocity_even_across_its_yaw() -> None:
    moved = dynamics.bicycle_forward(State(0, 0, 0, 0, 10), 2.0, 0.0, 0.1)
    np.testing.assert_allclose(moved, (0.01, 1.0, 0, 10.2, 0), atol=ROUNDING)


def test_bicycle_clips_its_action() -> None:
    state = State(1, 2, 0.5, 8, 3)
    for sign in (1, -1):
        clipped = dynamics.bicycle_forward(state, sign * 6.0, sign * 0.3, 0.1)
        beyond = dynamics.bicycle_forward(state, sign * 9.0, sign * 2.0, 0.1)
        assert beyond == clipped


@pytest.mark.parametrize("seed", range(12))
def test_bicycle_inverse_undoes_forward_when_moving(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, yaw, vx, vy = rng.uniform((-50, -50, -3.1, 2, 2), (50, 50, 3.1, 9, 9))
    acceleration, curvature = rng.uniform((-6, -0.3), (6, 0.3))
    before = State(x, y, yaw, vx, vy)
    after = dynamics.bicycle_forward(before, acceleration, curvature, 0.1)
    np.testing.assert_allclose(
        dynamics.bicycle_inverse(before, after, 0.1, MOVING),
        (acceleration, curvature),
        atol=100 * ROUNDING,  # differences of speeds are divided by 0.1 s and 0.2 m
    )


def test_inverse_takes_the_direction_of_the_velocity_of_a_moving_object() -> None:
    # From 3 to 5 m/s: a = 20, d = 0.3 + 0.1 = 0.4 m; the velocity points to (4, 3).
    before, after = State(0, 0, 0, 3, 0), State(0, 0, 1, 4, 3)
    expected = (20, math.atan(0.75) / 0.4)
    inverse = dynamics.bicycle_inverse(before, after, 0.1, MOVING)
    np.testing.assert_allclose(inverse, expected, atol=100 * ROUNDING)


def test_inverse_takes_the_yaw_of_the_pose_of_a_standing_object() -> None:
    # From 0 to 0.5 m/s: a = 5, d = 0.025 m; 0.1 rad in it. Nothing is clipped.
    before, after = State(0, 0, 0, 0, 0), State(0, 0, 0.1, 0, 0.5)
    np.testing.assert_allclose(
        dynamics.bicycle_inverse(before, after, 0.1, MOVING), (5, 4), atol=ROUNDING
    )
    moving = dynamics.bicycle_inverse(before, after, 0.1, moving_speed=0.4)
    np.testing.assert_allclose(moving, (5, QUARTER / 0.025), atol=ROUNDING)


def test_inverse_has_no_curvature_over_less_than_a_millimetre() -> None:
    # From 0 to 0.01 m/s: a = 0.1, d = 0.5 mm.
    inverse = dynamics.bicycle_inverse(
        State(0, 0, 0, 0, 0), State(0, 0, 1, 0.01, 0), 0.1, MOVING
    )
    np.testing.assert_allclose(inverse, (0.1, 0), atol=ROUNDING)


def test_inverse_wraps_the_turn() -> None:
    # d = 1 m; from 3.1 to -3.1 rad is a turn to the left by 2 pi - 6.2.
    after = State(0, 0, -3.1, 10 * math.cos(-3.1), 10 * math.sin(-3.1))
    _, curvature = dynamics.bicycle_inverse(
        State(0, 0, 3.1, -10, 0), after, 0.1, MOVING
    )
    assert curvature == pytest.approx(2 * math.pi - 6.2, abs=100 * ROUNDING)


@pytest.mark.parametrize(
    ("acceleration", "curvature", "index"),
    [
        (-6.0, -0.25, 0),
        (6.0, 0.25, 64),
        (99.0, -99.0, 60),
        (0.4, 0.0, 32),  # bin 6 of 13, bin 2 of 5
        (0.6, 0.13, 38),  # bin 7, bin 3
        (0.5, 0.0, 32),  # place 6.5 goes to 6
        (1.5, 0.0, 42),  # place 7.5 goes to 8
        (0.0, 0.0625, 32),  # place 2.5 goes to 2
        (0.0, 0.1875, 34),  # place 3.5 goes to 4
    ],
)
def test_nearest_bin_half_to_even(
    acceleration: float, curvature: float, index: int
) -> None:
    value = (acceleration, curvature)
    assert dynamics.discretize(value, (-6, -0.25), (6, 0.25), (13, 5)) == index


def test_every_index_survives_its_action() -> None:
    low, high, bins = (-3, -0.7, -1.6), (2, 0.7, 1.6), (6, 21, 5)
    assert dynamics.undiscretize(0, low, high, bins) == low
    assert dynamics.undiscretize(629, low, high, bins) == high
    for index in range(630):
        action = dynamics.undiscretize(index, low, high, bins)
        assert dynamics.discretize(action, low, high, bins) == index
