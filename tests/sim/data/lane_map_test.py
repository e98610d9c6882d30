"""Tests of maps of lanes between bounds."""

from typing import Any

import numpy as np
import pytest

from drivetrain.sim.data import lane_map
from drivetrain.sim.data.lane_map import Lane
from drivetrain.sim.scenario import EDGES, LANES, MapType, ScenarioError

SAGITTA = 0.01  # metres between an arc of 40 m radius and its chords of 1.7 m


def lane(lane_id: int, start: float, end: float, y: float = 0.0, **fields: Any) -> Lane:
    """Returns a straight lane, four metres wide, along x."""
    return Lane(
        lane_id=lane_id,
        kind=MapType.LANE_SURFACE_STREET,
        left=np.array([[start, y + 2, 0], [end, y + 2, 0]]),
        right=np.array([[start, y - 2, 0], [end, y - 2, 0]]),
        **fields,
    )


def of_kinds(lanes: list[Lane], kinds: tuple[MapType, ...]) -> list[np.ndarray]:
    """Returns the points of a map's features of some kinds."""
    found = lane_map.roads(lanes, [lane.area for lane in lanes])
    rows = np.isin(found.map_type, kinds).nonzero()[0].tolist()
    return [found.points_of(row) for row in rows]


def test_the_centre_line_of_a_ring_is_the_circle_between() -> None:
    inner, outer = (np.linspace(0, 3, n) for n in (70, 101))
    left, right = (
        radius * np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
        for radius, a in ((38.0, inner), (42.0, outer))
    )
    bent = Lane(lane_id=1, kind=MapType.LANE_BIKE, left=left, right=right)
    radius = np.linalg.norm(bent.centre_line, axis=1)
    assert np.abs(radius - 40.0).max() < SAGITTA
    step = np.linalg.norm(np.diff(bent.centre_line, axis=0), axis=1)
    assert step.max() <= lane_map.SPACING
    assert np.ptp(step) < SAGITTA


def test_a_lane_without_length_has_two_points() -> None:
    assert lane(1, 5.0, 5.0).centre_line.tolist() == [[5, 0, 0], [5, 0, 0]]


def test_lanes_keep_their_ids_and_no_id_comes_twice() -> None:
    lanes = [lane(1, 0, 10, left_line=MapType.LINE_UNKNOWN), lane(3, 10, 20)]
    crosswalk = (MapType.CROSSWALK, 0, np.zeros((3, 3)))
    found = lane_map.roads(lanes, [lane.area for lane in lanes], [crosswalk])
    ids = dict(zip(found.feature_id.tolist(), found.map_type.tolist(), strict=True))
    assert len(ids) == found.num_features
    assert [ids[i] for i in (1, 3, 0)] == [2, 2, MapType.CROSSWALK]


def test_a_line_that_two_lanes_share_comes_once() -> None:
    lanes = [
        lane(1, 0, 10, left_line=MapType.LINE_SOLID_SINGLE_WHITE),
        lane(2, 0, 10, y=4.0, right_line=MapType.LINE_SOLID_SINGLE_WHITE),
        lane(3, 10, 0, y=4.0, left_line=MapType.LINE_SOLID_SINGLE_WHITE),
    ]
    (line,) = of_kinds(lanes[:2], (MapType.LINE_SOLID_SINGLE_WHITE,))
    assert line.tolist() == [[0, 2, 0], [10, 2, 0]]
    assert len(of_kinds(lanes, (MapType.LINE_SOLID_SINGLE_WHITE,))) == 2


def test_the_road_is_open_where_the_first_and_last_lanes_end() -> None:
    lanes = [lane(1, 0, 10, successors=(2,)), lane(2, 10, 20, predecessors=(1,))]
    ends = sorted(edge[[0, -1], :2].tolist() for edge in of_kinds(lanes, EDGES))
    assert np.allclose(ends, [[[0, -2], [20, -2]], [[20, 2], [0, 2]]])


@pytest.mark.parametrize(("told", "by"), [("successors", 0), ("predecessors", 1)])
def test_a_link_told_at_one_end_is_enough(told: str, by: int) -> None:
    lanes = [lane(1, 0, 10), lane(2, 10, 20)]
    fields = {told: (2 - by,)}
    lanes[by] = lane(by + 1, 10.0 * by, 10.0 * by + 10, **fields)
    assert lane_map.links(lanes).successor.tolist() == [[1, 2]]
    assert len(of_kinds(lanes, EDGES)) == 2


def test_links_carry_neighbours_limits_and_stops() -> None:
    lanes = [lane(1, 0, 10, neighbors=(2,), speed_limit=13.0), lane(2, 0, 10, y=4.0)]
    found = lane_map.links(lanes, [(9, 1)])
    assert found.neighbor.tolist() == [[1, 2]]
    assert found.stop.tolist() == [[9, 1]]
    assert (found.limited.tolist(), found.limit.tolist()) == ([1], [13.0])


def test_a_map_of_nothing_has_no_features() -> None:
    assert lane_map.roads([], []).num_features == 0


def test_a_bound_of_one_point_is_named() -> None:
    with pytest.raises(ScenarioError, match="lane 7 has bounds of 1 and 2 points"):
        Lane(
            lane_id=7,
            kind=MapType.LANE_BIKE,
            left=np.zeros((1, 3)),
            right=np.zeros((2, 3)),
        )


@pytest.mark.parametrize("end", [1e6, 1e300, np.nan, np.inf])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_a_lane_that_leads_too_far_is_named(end: float) -> None:
    with pytest.raises(ScenarioError, match="lane 1 is"):
        lane_map.roads([lane(1, 0, end)], [])


def test_lanes_that_are_too_long_together_are_named() -> None:
    lanes = [lane(i, 0, 4e5) for i in range(2)]
    with pytest.raises(ScenarioError, match="lanes are 800002 m long"):
        lane_map.roads(lanes, [])


def test_lanes_of_all_kinds_are_lanes() -> None:
    assert len(of_kinds([lane(1, 0, 10)], LANES)) == 1
