"""Tests of the edges around areas."""

import numpy as np
import pytest

from drivetrain.sim.data import road_outline
from drivetrain.sim.scenario import ScenarioError
from tests.oracles import metrics

EXACT = 1e-9  # metres: growing and shrinking areas of some 100 m by 0.25 m in float64


def box(x0: float, y0: float, x1: float, y1: float, z: float = 0.0) -> np.ndarray:
    """Returns the corners of a rectangle, clockwise."""
    return np.array([[x0, y0, z], [x0, y1, z], [x1, y1, z], [x1, y0, z]])


def signed_area(ring: np.ndarray) -> float:
    """Returns the area of a closed ring, positive if it goes anticlockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2)


def only(
    areas: list[np.ndarray], openings: list[np.ndarray] | None = None
) -> np.ndarray:
    """Returns the only edge of a road without islands."""
    (edge,), islands = road_outline.edges(areas, openings or [])
    assert islands == []
    return edge


@pytest.mark.parametrize("second", [box(10, 0, 25, 4), box(25, 4, 10, 0)])
def test_areas_that_touch_have_no_edge_between_them(second: np.ndarray) -> None:
    edge = only([box(0, 0, 10, 4), second])
    assert np.array_equal(edge[0], edge[-1])
    assert abs(signed_area(edge) - 25 * 4) < EXACT
    assert len(edge) == 5


def test_areas_that_overlap_keep_what_lies_outside_both() -> None:
    edge = only([box(-20, -3, 20, 3), box(-2, -20, 2, 20)])
    assert abs(signed_area(edge) - (40 * 6 + 40 * 4 - 6 * 4)) < EXACT
    assert len(edge) == 13


@pytest.mark.parametrize(("gap", "num_roads"), [(0.4, 1), (0.6, 2)])
def test_half_a_metre_parts_two_roads(gap: float, num_roads: int) -> None:
    outer, _ = road_outline.edges([box(0, 0, 10, 4), box(10 + gap, 0, 20, 4)], [])
    assert len(outer) == num_roads


def test_an_island_has_the_road_on_its_left() -> None:
    around = [box(0, 0, 30, 4), box(0, 0, 4, 30), box(26, 0, 30, 30)]
    (outer,), (island,) = road_outline.edges([*around, box(0, 26, 30, 30)], [])
    assert abs(signed_area(outer) - 30**2) < EXACT
    assert abs(signed_area(island) + 22**2) < EXACT


def test_a_seam_is_no_island() -> None:
    around = [box(0, 0, 30, 10), box(0, 0, 10, 30), box(11, 0, 30, 30)]
    _, islands = road_outline.edges([*around, box(0, 11, 30, 30)], [])
    assert islands == []


@pytest.mark.parametrize("seed", range(8))
def test_points_in_an_area_are_on_the_road_and_others_are_off(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-40, 40, (12, 2))
    high = low + rng.uniform(5, 40, (12, 2))
    outer, islands = road_outline.edges(
        [box(*a, *b) for a, b in zip(low, high, strict=True)], []
    )
    # Up to a half diagonal from a corner of a gap of half a metre all may be road.
    margin = 2 * road_outline.GAP
    for xy in rng.uniform(-60, 100, (300, 2)):
        depth = np.minimum(xy - low, high - xy).min(axis=1).max()
        distance = metrics.signed_distance(np.append(xy, 0.0), [*outer, *islands])
        if depth > 0:
            assert distance <= EXACT
        if depth < -margin and distance < 0:  # then in a seam or in the corner of one
            near = np.minimum(xy - low, high - xy).min(axis=1) > -4 * margin
            assert near.sum() >= 2


@pytest.mark.parametrize("seed", range(4))
def test_moving_and_turning_the_areas_moves_and_turns_the_edges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = rng.uniform(-3, 3), rng.uniform(-1000, 1000, 3)
    rotation = np.eye(3)
    rotation[:2, :2] = [
        [np.cos(turn), np.sin(turn)],
        [-np.sin(turn), np.cos(turn)],
    ]
    areas = [box(-20, -3, 20, 3), box(-2, -20, 2, 20)]
    moved = only([area @ rotation + shift for area in areas])
    wanted = only(areas) @ rotation + shift
    # Which corner comes first is not told.
    gap = np.linalg.norm(moved[:, None] - wanted, axis=-1)
    assert gap.min(axis=0).max() < 1e-8  # float64 at 1,000 m, through a few sines
    assert abs(signed_area(moved) - signed_area(wanted)) < 1e-5  # products of 10^6 m^2


def test_a_road_is_open_where_it_leads_out_of_the_map() -> None:
    ends = [np.array([[x, -2.0, 0], [x, 2, 0]]) for x in (0.0, 50.0)]
    outer, _ = road_outline.edges([box(0, -3, 50, 3)], ends)
    assert len(outer) == 2
    low, high = sorted(outer, key=lambda edge: edge[0, 1])
    assert np.allclose(low[[0, -1], :2], [[0, -3], [50, -3]], rtol=0, atol=EXACT)
    assert np.allclose(high[[0, -1], :2], [[50, 3], [0, 3]], rtol=0, atol=EXACT)


def test_openings_that_overlap_count_once() -> None:
    across = [np.array([[0.0, y, 0], [0, y + 2.5, 0]]) for y in (-3, -2, -1.5, 0.5)]
    (edge,), _ = road_outline.edges([box(0, -3, 50, 3)], across)
    assert np.allclose(edge[[0, -1], :2], [[0, -3], [0, 3]], rtol=0, atol=EXACT)


def test_an_opening_inside_the_road_opens_nothing() -> None:
    ends = [np.array([[25.0, -3.0, 0], [25.0, 3, 0]])]
    edge = only([box(0, -3, 50, 3)], ends)
    assert np.array_equal(edge[0], edge[-1])


def test_edges_lie_as_high_as_the_areas() -> None:
    edge = only([box(0, 0, 10, 4, z=5.0), box(10, 0, 20, 4, z=6.0)])
    assert set(edge[edge[:, 0] < 9, 2]) == {5.0}
    assert set(edge[edge[:, 0] > 11, 2]) == {6.0}


def test_no_area_has_no_edges() -> None:
    assert road_outline.edges([], []) == ([], [])
    assert road_outline.edges([np.zeros((2, 3)), np.zeros((5, 3))], []) == ([], [])


def test_an_area_that_crosses_itself_still_makes_a_road() -> None:
    outer, _ = road_outline.edges([box(0, 0, 10, 10)[[0, 2, 1, 3]]], [])
    assert outer
    assert all(signed_area(edge) > 0 for edge in outer)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_a_point_nowhere_is_named(value: float) -> None:
    area = box(0, 0, 10, 4)
    area[2, 1] = value
    with pytest.raises(ScenarioError, match="not a finite number of metres"):
        road_outline.edges([area], [])


def test_an_area_out_of_order_is_named() -> None:
    tangle = np.random.default_rng(0).uniform(0, 100, (500, 3))
    with pytest.raises(ScenarioError, match=r"the 500 sides .* cross too often"):
        road_outline.edges([tangle], [])


def test_areas_that_cross_too_often_are_named() -> None:
    bars = [box(0, i, 100, i + 0.1) for i in range(100)]
    crossing = [bar[:, [1, 0, 2]] for bar in bars]
    with pytest.raises(ScenarioError, match=r"the 800 sides .* cross too often"):
        road_outline.edges([*bars, *crossing], [])


def test_openings_that_cross_too_often_are_named() -> None:
    lines = np.random.default_rng(0).uniform(0, 100, (500, 2, 3))
    with pytest.raises(ScenarioError, match=r"the 1004 sides .* cross too often"):
        road_outline.edges([box(0, 0, 10, 10)], list(lines))


def test_too_many_points_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(road_outline, "MAX_POINTS", 3)
    with pytest.raises(ScenarioError, match="have 4 points, at most 3 are read"):
        road_outline.edges([box(0, 0, 1, 1)], [])
