"""Tests the graph of lanes by maps drawn by hand."""

import numpy as np
import pytest

from drivetrain.sim.data import lane_graph, parts
from drivetrain.sim.data.lane_graph import LaneGraph
from drivetrain.sim.scenario import LaneLinks, MapType, Polylines

ROUNDING = 1e-9  # metres, float64 near the origin


def roads(*lanes: np.ndarray, kind: MapType = MapType.LANE_SURFACE_STREET) -> Polylines:
    """Returns a map of lanes with the ids 10, 11 and so on."""
    return Polylines(
        xyz=np.concatenate(lanes),
        offset=np.cumsum([0, *map(len, lanes)]),
        map_type=np.full(len(lanes), int(kind)),
        feature_id=10 + np.arange(len(lanes)),
    )


def lane(x: float, y: float, degrees: float, z: float = 0.0) -> np.ndarray:
    """Returns a lane of 20 m from a place on."""
    angle = np.radians(degrees)
    along = np.linspace(0.0, 20.0, 21)[:, None]
    return np.array([x, y, z]) + along * [[np.cos(angle), np.sin(angle), 0.0]]


FIRST = lane(0.0, 0.0, 0.0)  # ends at (20, 0)


def follows(second: np.ndarray) -> bool:
    """Tells whether the first lane leads into another, without links."""
    graph = lane_graph.lane_graph(roads(FIRST, second), None)
    assert set(graph.successors) <= {0}
    return graph.successors.get(0, []) == [1]


@pytest.mark.parametrize(
    ("x", "y", "z", "joins"),
    [
        (20.0, 0.0, 0.0, True),
        (20.9, 0.0, 0.0, True),
        (21.1, 0.0, 0.0, False),
        (20.0, -0.9, 0.0, True),
        (20.0, 1.1, 0.0, False),
        (20.8, 0.0, 0.8, False),  # 1.13 m in three dimensions
        (22.0, 0.0, 0.0, False),
    ],
)
def test_ends_join_within_a_metre(x, y, z, joins):
    assert follows(lane(x, y, 0.0, z)) == joins


@pytest.mark.parametrize(
    ("degrees", "joins"),
    [(0, True), (28, True), (-28, True), (32, False), (-45, False), (180, False)],
)
def test_ends_join_within_thirty_degrees(degrees, joins):
    assert follows(lane(20.0, 0.0, degrees)) == joins


def linked(links: LaneLinks, *lanes: np.ndarray) -> LaneGraph:
    return lane_graph.lane_graph(roads(*lanes), links)


def test_links_count_where_there_are_some_and_ends_do_not():
    links = parts.lane_links([(10, 12), (10, 99)], [(11, 10), (98, 10)], [], {})

    graph = linked(links, FIRST, lane(20.0, 0.0, 0.0), lane(50.0, 9.0, 90.0))

    assert graph.successors == {0: [2]}
    assert graph.neighbors == {1: [0]}


def test_limits_are_those_of_the_lanes_that_have_one():
    links = parts.lane_links([], [], [], {11: 13.0, 99: 20.0})

    graph = linked(links, FIRST, lane(20.0, 0.0, 0.0))

    assert not graph.limit[graph.first[0] : graph.last[0] + 1].any()
    assert (graph.limit[graph.first[1] : graph.last[1] + 1] == 13.0).all()


def test_bike_lanes_are_no_driving_lanes():
    graph = lane_graph.lane_graph(roads(FIRST, kind=MapType.LANE_BIKE), None)

    assert not len(graph.xyz) and not graph.first


def test_long_segments_are_cut_and_lanes_keep_their_ends():
    sparse = np.array([[0.0, 0, 0], [10.5, 0, 2.1], [10.5, 0.4, 2.1]])

    graph = lane_graph.lane_graph(roads(sparse, FIRST), None)

    assert (graph.first, graph.last) == ([0, 13], [12, 33])
    np.testing.assert_allclose(graph.xyz[[0, 11, 12]], sparse, atol=ROUNDING)
    own = graph.xyz[: 12 + 1]
    length = np.linalg.norm(np.diff(own[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(length, [*[10.5 / 11] * 11, 0.4], atol=ROUNDING)
    # Height rises evenly with the way.
    np.testing.assert_allclose(own[:12, 2], own[:12, 0] / 5, atol=ROUNDING)
    np.testing.assert_array_equal(graph.xyz[13:], FIRST)


def test_a_map_of_absurd_length_asks_for_no_memory():
    vast = np.array([[0.0, 0, 0], [1e12, 0, 0]])

    graph = lane_graph.lane_graph(roads(vast, FIRST), None)

    assert len(graph.xyz) <= lane_graph.MAX_POINTS + 100


def test_a_map_without_lanes_has_an_empty_graph():
    graph = lane_graph.lane_graph(roads(FIRST, kind=MapType.CROSSWALK), None)

    assert graph.successors == graph.neighbors == {}


def test_stations_measure_the_way_in_the_plane():
    xyz = np.array([[0.0, 0, 0], [3.0, 4, 7], [3.0, 4, 9], [3.0, 5, 9]])

    assert lane_graph.stations(xyz).tolist() == [0.0, 5.0, 5.0, 6.0]
