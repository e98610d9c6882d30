"""Tests of the oracles by numbers worked by hand; the IDM has a file of its own."""

import math

import numpy as np
import pytest

from tests.oracles import geometry, metrics, routes
from tests.oracles.dynamics import State
from tests.oracles.geometry import Box

ROUNDING = 1e-12  # float64, a few operations on numbers up to 100
QUARTER = math.pi / 2


def box(x: float, y: float, yaw: float = 0.0) -> Box:
    """Returns a car of 4 m by 2 m."""
    return Box(np.array([x, y]), yaw, 4.0, 2.0)


def points(*rows: tuple[float, ...]) -> np.ndarray:
    """Returns the rows as an array of floats."""
    return np.array(rows, dtype=float)


# Angles and boxes


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(3.5, 3.5 - 2 * math.pi), (-7.0, 2 * math.pi - 7.0), (math.pi, math.pi)],
)
def test_wrapping_keeps_the_direction(angle: float, wrapped: float) -> None:
    assert geometry.wrap_angle(angle) == pytest.approx(wrapped, abs=ROUNDING)


def test_corners_of_a_car_that_faces_left() -> None:
    expected = [(9, 12), (9, 8), (11, 8), (11, 12)]
    np.testing.assert_allclose(
        geometry.corners(box(10, 10, QUARTER)), expected, atol=ROUNDING
    )


@pytest.mark.parametrize(
    ("other", "overlaps"),
    [
        (box(3.99, 0), True),
        (box(4, 0), False),  # touches with its bumper
        (box(4, 2), False),  # touches with a corner
        (box(0, 2.99, QUARTER), True),
        (box(0, 3.01, QUARTER), False),
        (box(0, 0), True),
        # Turned by 45 degrees, its nearest corner is (x - 3 / sqrt 2, y - 1 / sqrt 2).
        (box(4.12, 0.7071, math.pi / 4), True),
        (box(4.13, 0.7071, math.pi / 4), False),
        # Only an axis of the turned box separates: its rear right corner passes above.
        (box(3.6, 2.9, math.pi / 4), False),
    ],
)
def test_boxes_overlap_only_with_area(other: Box, overlaps: bool) -> None:
    assert geometry.boxes_overlap(box(0, 0), other) is overlaps
    assert geometry.boxes_overlap(other, box(0, 0)) is overlaps


def test_collision_ignores_what_is_not_valid() -> None:
    xy = points((0, 0), (17, 0), (2, 0), (20, 0))
    size = np.tile([4.0, 2.0, 1.5], (4, 1))
    valid = np.array([True, False, True, True])
    collides = metrics.collision(xy, np.zeros(4), size, valid)
    assert collides.tolist() == [True, False, True, False]


# Road edges. HAIRPIN runs east to a tip above the origin and back: its road is the thin
# wedge on its left. East of the tip is off the road, though one segment says "left".

HAIRPIN = points((-1, 0, 3), (0, 0, 3), (-10, 1, 3))
EAST_OF_TIP = points((1, 0.3, 3), (1, -0.3, 3), (1, 0, 3))


def test_left_of_an_edge_is_the_road() -> None:
    edge = points((0, 0, 0), (10, 0, 0))
    assert metrics.signed_distance(np.array([5.0, 3, 0]), [edge]) == -3
    assert metrics.signed_distance(np.array([5.0, -3, 0]), [edge]) == 3
    # Beyond a free end, the line of the only segment decides.
    assert metrics.signed_distance(np.array([13.0, 4, 0]), [edge]) == -5
    assert metrics.signed_distance(np.array([13.0, -4, 0]), [edge]) == 5


def test_height_is_not_part_of_the_distance() -> None:
    edge = points((0, 0, 0), (10, 0, 0))
    assert metrics.signed_distance(np.array([5.0, -3, 4]), [edge]) == 3


def test_both_segments_decide_at_a_vertex() -> None:
    expected = np.array([math.hypot(1, 0.3), math.hypot(1, 0.3), 1])
    for edge, side in ((HAIRPIN, 1), (HAIRPIN[::-1], -1)):
        distances = [metrics.signed_distance(point, [edge]) for point in EAST_OF_TIP]
        np.testing.assert_allclose(distances, side * expected, atol=ROUNDING)


def test_a_closed_loop_is_closed() -> None:
    loop = HAIRPIN[[1, 2, 0, 1]]
    for point in EAST_OF_TIP:
        assert metrics.signed_distance(point, [loop]) > 0


@pytest.mark.parametrize(
    ("start", "joined"),
    [((0, 0, 3), True), ((0, 0, 3.009), True), ((-0.02, 0.002, 3), False)],
)
def test_edges_are_joined_within_a_centimetre(
    start: tuple[float, float, float], joined: bool
) -> None:
    edges = [HAIRPIN[:2], points(start, (-10, 1, 3))]
    sides = [metrics.signed_distance(point, edges) > 0 for point in EAST_OF_TIP]
    assert sides == ([True, True, True] if joined else [False, True, False])


def test_segments_without_length_do_not_count() -> None:
    edge = HAIRPIN[[0, 0, 1, 1, 2]]
    for point in EAST_OF_TIP:
        assert metrics.signed_distance(point, [edge]) > 0


def test_height_counts_double_between_levels() -> None:
    # The car is on the upper level at z = 5, whose edge is 7 m to its right. The lower
    # edge is 1 m to its left: at 5.1 m by plain height, at 10.05 m by double height.
    upper = points((-10, -7, 5), (10, -7, 5))
    lower = points((-10, 1, 0), (10, 1, 0))
    assert metrics.signed_distance(np.array([0.0, 0, 5]), [lower, upper]) == -7
    assert metrics.signed_distance(np.array([0.0, 0, 0]), [lower, upper]) == 1


def test_one_corner_over_the_edge_is_offroad() -> None:
    edge = points((-50, -2, 0), (50, -2, 0))
    assert not metrics.offroad(box(0, -0.5), 0.0, [edge])
    assert metrics.offroad(box(0, -1.1), 0.0, [edge])
    assert metrics.offroad(box(0, -0.5, 0.5), 0.0, [edge])


def test_without_edges_nothing_is_offroad() -> None:
    assert not metrics.offroad(box(0, 0), 0.0, [])
    assert not metrics.offroad(box(0, 0), 0.0, [points((9, 9, 0))])


@pytest.mark.parametrize(
    ("after", "infeasible"),
    [
        (State(0, 0, 0, 10.65, 0), False),  # 6.5 m/s^2, the slack is 1
        (State(0, 0, 0, 10.75, 0), True),  # 7.5
        (State(0, 0, 0, 9.25, 0), True),  # -7.5
        (State(0, 0, 0.35, 10, 0), False),  # 0.35 1/m
        (State(0, 0, 0.45, 10, 0), True),
        (State(0, 0, -0.45, 10, 0), True),
        (State(0, 0, 0, 10 * math.cos(0.45), 10 * math.sin(0.45)), False),  # slips
    ],
)
def test_what_the_bicycle_cannot_do(after: State, infeasible: bool) -> None:
    before = State(0, 0, 0, 10, 0)
    assert metrics.kinematic_infeasibility(before, after, 0.1, (1.0, 0.1)) is infeasible


def test_displacement_needs_the_object_and_its_log() -> None:
    valid = np.array([True, True, False])
    log_valid = np.array([True, False, True])
    distance, defined = metrics.displacement(
        points((1, 1), (1, 1), (1, 1)), valid, points((4, 5), (4, 5), (4, 5)), log_valid
    )
    assert distance.tolist() == [5, 0, 0]
    assert defined.tolist() == [True, False, False]


# Routes. FORK parts at (50, 0): one path turns left, one right; the log turned left and
# stopped 30 m after the fork, 80 m from the start of the paths.

FORK = [points((0, 0), (50, 0), (50, 90)), points((0, 0), (50, 0), (50, -90))]
LEFT_IS_ON = np.array([True, False])
LOG_XY = points((99, 99), (10, 1), (50, 0), (50, 30), (0, 0))
LOG_VALID = np.array([False, True, True, True, False])


@pytest.mark.parametrize(
    ("xy", "ratio"),
    # The last is nearest to (49, 0): the off-route path beside it does not count.
    [((9, 3), -1 / 70), ((45, 3), 0.5), ((52, 65), 1.5), ((49, -20), 39 / 70)],
)
def test_progress_counts_from_the_log_along_the_path(
    xy: tuple[float, float], ratio: float
) -> None:
    progress = routes.progress_ratio(np.array(xy), FORK, LEFT_IS_ON, LOG_XY, LOG_VALID)
    assert progress == pytest.approx(ratio, abs=ROUNDING)


def test_progress_is_measured_on_the_path_nearest_to_the_ego() -> None:
    # Both are on-route; on the right-hand path the log projects to 10 m and to 50 m.
    both = np.array([True, True])
    xy = np.array([50.0, -10])
    assert routes.progress_ratio(xy, FORK, both, LOG_XY, LOG_VALID) == 1.25


@pytest.mark.parametrize(("y", "ratio"), [(-0.04, 40 / 70), (-0.2, 40.2 / 40)])
def test_of_paths_that_are_equally_near_the_first_counts(
    y: float, ratio: float
) -> None:
    # The right-hand path is nearer by |y|; the left-hand one counts within 0.1 m.
    both = np.array([True, True])
    progress = routes.progress_ratio(np.array([50.0, y]), FORK, both, LOG_XY, LOG_VALID)
    assert progress == pytest.approx(ratio, abs=ROUNDING)


def test_progress_of_a_log_that_stands_still_is_one() -> None:
    standing = points((10, 1), (10.0005, 1))
    xy, valid = np.array([30.0, 0]), np.array([True, True])
    assert routes.progress_ratio(xy, FORK, LEFT_IS_ON, standing, valid) == 1.0


@pytest.mark.parametrize(
    ("xy", "is_off", "distance"),
    [
        ((20, 4.9), False, 4.9),
        ((20, 5.1), True, 5.1),
        ((50, -1.9), False, 1.9),  # 1.9 m from the fork, on the off-route path
        ((50, -2.1), True, 2.1),
        ((47, 40), False, 3),
    ],
)
def test_leaving_the_route(
    xy: tuple[float, float], is_off: bool, distance: float
) -> None:
    verdict, from_route = routes.off_route(np.array(xy), FORK, LEFT_IS_ON)
    assert verdict is is_off
    assert from_route == pytest.approx(distance, abs=ROUNDING)
