"""Tests of the parts that the readers of WOMD share."""

import math

import numpy as np
import pytest

from drivetrain.sim.data import parts
from drivetrain.sim.scenario import LightState, MapType, ScenarioError

ROUNDING = 1e-13  # float64, one turn taken off an angle of a few turns


def test_the_size_is_that_of_the_valid_step_nearest_to_now() -> None:
    size = np.arange(3 * 5 * 3, dtype=float).reshape(3, 5, 3)
    valid = np.array([[1, 1, 1, 1, 1], [1, 0, 0, 0, 1], [0, 0, 0, 0, 0]]) > 0
    found = parts.constant_size(size, valid, current_step=3)
    assert np.array_equal(found[0], size[0, 3])
    assert np.array_equal(found[1], size[1, 4])
    assert np.array_equal(found[2], np.zeros(3))


def test_tracks_without_steps_are_an_error() -> None:
    with pytest.raises(ScenarioError, match="the tracks have no steps"):
        parts.constant_size(np.zeros((2, 0, 3)), np.zeros((2, 0), bool), 10)


def test_wrapping_keeps_the_direction_and_leaves_small_angles_alone() -> None:
    angle = np.linspace(-20, 20, 401)
    found = parts.wrap_angle(angle)
    assert (np.abs(found) <= math.pi).all()
    assert np.allclose(np.exp(1j * found), np.exp(1j * angle), rtol=0, atol=ROUNDING)
    small = np.abs(angle) < math.pi
    assert np.array_equal(found[small], angle[small])


def test_a_fill_is_never_seen() -> None:
    values = np.array([[1.0, np.nan], [np.inf, -1.0]])
    assert not parts.zero_unless(np.zeros(2, bool), values).any()


def test_codes_of_objects_beyond_the_known_are_other_and_below_are_unset() -> None:
    assert parts.object_types(np.array([-1, 0, 1, 4, 5, 99])).tolist() == [
        *(0, 0, 1, 4, 4, 4)
    ]


def test_open_polygons_are_closed_and_empty_features_left_out() -> None:
    xyz = np.arange(30.0).reshape(10, 3)
    xyz[9] = xyz[7]
    found = parts.polylines(
        xyz,
        np.array([3, 0, 3, 1, 3]),
        np.array([MapType.CROSSWALK, 2, 2, MapType.STOP_SIGN, MapType.DRIVEWAY]),
        np.array([10, 11, 12, 13, 14]),
    )
    assert found.feature_id.tolist() == [10, 12, 13, 14]
    assert found.offset.tolist() == [0, 4, 7, 8, 11]
    assert np.array_equal(found.points_of(0), xyz[[0, 1, 2, 0]])
    assert np.array_equal(found.points_of(1), xyz[3:6])
    assert np.array_equal(found.points_of(3), xyz[7:10])


def test_a_light_stands_where_it_was_first_seen() -> None:
    found = parts.lights(
        lane_id=np.array([7, 5, 7, 7]),
        step=np.array([3, 1, 2, 0]),
        state=np.array([LightState.GO, 99, LightState.STOP, LightState.GO]),
        xyz=np.arange(12.0).reshape(4, 3),
        valid=np.array([True, True, True, False]),
        num_steps=4,
    )
    assert found.lane_id.tolist() == [5, 7]
    assert found.valid.tolist() == [[0, 1, 0, 0], [0, 0, 1, 1]]
    assert found.state.tolist() == [[0, 0, 0, 0], [0, 0, LightState.STOP, 6]]
    assert found.xyz.tolist() == [[3, 4, 5], [6, 7, 8]]


def test_absurdly_many_lights_ask_for_no_memory() -> None:
    num_rows = 20_000
    with pytest.raises(ScenarioError, match="20000 lanes with traffic lights"):
        parts.lights(
            lane_id=np.arange(num_rows),
            step=np.zeros(num_rows, np.int64),
            state=np.zeros(num_rows, np.int64),
            xyz=np.zeros((num_rows, 3)),
            valid=np.ones(num_rows, bool),
            num_steps=num_rows,
        )


def test_the_step_is_the_median_one() -> None:
    assert parts.step_length([0.0, 0.1001, 0.2, 0.2999, 0.9]) == 0.1
    assert parts.step_length([0.0, 0.1004, 0.2008]) == 0.1
    assert parts.step_length([3.0, 3.5]) == 0.5
    assert parts.step_length([i / 30 for i in range(300)]) == pytest.approx(
        1 / 30, 1e-9
    )
    assert parts.step_length([]) == 0.1
    with pytest.raises(ScenarioError, match="the times of the steps do not rise"):
        parts.step_length([1.0, 1.0, 1.0])
    with pytest.raises(ScenarioError, match="the times of the steps do not rise"):
        parts.step_length([0.0, np.nan])


def test_a_count_beyond_the_most_is_named() -> None:
    parts.require_few(3, 3, "states")
    with pytest.raises(ScenarioError, match="there are 4 states, and at most 3 are"):
        parts.require_few(4, 3, "states")
