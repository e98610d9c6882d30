"""Tests that simplified polylines stay within their tolerance."""

import itertools

import numpy as np
from hypothesis import given, settings, strategies as st

from drivetrain.sim.data.simplify import kept_points
from tests.oracles import geometry

ROUNDING = 1e-9  # metres: float64 at distances of hundreds of metres

seeds = st.integers(0, 2**32 - 1)
tolerances = st.floats(0.001, 3.0)


def polylines(seed: int, standing: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Returns random walks of 1 to 40 points, with a share of steps of no length."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 41, size=rng.integers(1, 6))
    turn = np.cumsum(rng.normal(0.0, 0.3, lengths.sum()))
    step = rng.uniform(0.0, 2.0, lengths.sum()) * (
        rng.random(lengths.sum()) >= standing
    )
    walk = np.stack([np.cos(turn), np.sin(turn), 0.1 * np.sin(3 * turn)], axis=1)
    xyz = np.cumsum(step[:, None] * walk, axis=0)
    return xyz, np.concatenate([[0], np.cumsum(lengths)])


def textbook(xyz: np.ndarray, tolerance: float) -> np.ndarray:
    """Simplifies one polyline as Douglas and Peucker wrote it: by recursion."""
    kept = np.zeros(len(xyz), bool)
    kept[[0, -1]] = True
    if len(xyz) < 3:
        return kept
    distance = [chord_distance(point, xyz[0], xyz[-1]) for point in xyz[1:-1]]
    split = 1 + int(np.argmax(distance))
    if distance[split - 1] > tolerance:
        kept[: split + 1] |= textbook(xyz[: split + 1], tolerance)
        kept[split:] |= textbook(xyz[split:], tolerance)
    return kept


def chord_distance(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Returns the distance of a point to the segment between two others."""
    _, foot = geometry.feet(point, start[None], end[None])
    return float(np.linalg.norm(point - foot[0]))


@settings(max_examples=60, deadline=None)
@given(seeds, tolerances)
def test_no_dropped_point_is_farther_from_its_chord_than_the_tolerance(seed, tolerance):
    xyz, offset = polylines(seed)
    kept = np.flatnonzero(kept_points(xyz, offset, tolerance))

    for i in range(len(xyz)):
        before, after = kept[kept <= i].max(), kept[kept >= i].min()
        distance = chord_distance(xyz[i], xyz[before], xyz[after])
        assert distance <= tolerance + ROUNDING


@settings(max_examples=60, deadline=None)
@given(seeds, tolerances)
def test_the_ends_of_each_polyline_are_kept(seed, tolerance):
    xyz, offset = polylines(seed)
    kept = kept_points(xyz, offset, tolerance)

    assert kept[offset[:-1]].all() and kept[offset[1:] - 1].all()


@settings(max_examples=40, deadline=None)
@given(seeds, tolerances)
def test_all_polylines_at_once_equal_the_recursion_one_by_one(seed, tolerance):
    xyz, offset = polylines(seed, standing=0.0)  # of equals the recursion takes one
    wanted = [
        textbook(xyz[first:end], tolerance) for first, end in itertools.pairwise(offset)
    ]

    found = kept_points(xyz, offset, tolerance)

    np.testing.assert_array_equal(found, np.concatenate(wanted))


def test_a_straight_line_keeps_its_ends_alone():
    xyz = np.linspace([0.0, 0.0, 0.0], [90.0, 30.0, 6.0], 100)

    kept = kept_points(xyz, np.array([0, 100]), 1e-6)

    assert np.flatnonzero(kept).tolist() == [0, 99]


def test_a_bump_in_height_counts_as_one_in_the_plane_does():
    xyz = np.array([[0.0, 0, 0], [1.0, 0, 0.2], [2.0, 0, 0]])

    assert kept_points(xyz, np.array([0, 3]), 0.1).all()
    assert not kept_points(xyz, np.array([0, 3]), 0.3)[1]


def test_a_loop_is_not_flattened_to_its_common_end():
    angle = np.linspace(0, 2 * np.pi, 61)
    xyz = 10 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    xyz[-1] = xyz[0]

    kept = xyz[kept_points(xyz, np.array([0, 61]), 0.5)]

    assert np.ptp(kept, axis=0)[:2].min() > 18.0
