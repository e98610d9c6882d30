"""Tests of the paths that are found for the ego."""

import dataclasses
import pathlib

import numpy as np
import pytest

from drivetrain.sim.data import build, parts, routes
from drivetrain.sim.scenario import Scenario
from tests.sim.data import by_hand

REAL = pathlib.Path(__file__).resolve().parents[3] / "../shared/data/womd_json"
STEPS = 91
HALF_SPACING = (
    0.25  # metres: the nearest of points 0.5 m apart is as far along the line
)
ROUNDING = 1e-9  # metres, float64 near the origin


def straight(x0: float, x1: float, y: float = 0.0) -> np.ndarray:
    x = np.linspace(x0, x1, round(abs(x1 - x0)) + 1)
    return np.stack([x, np.full_like(x, y), np.zeros_like(x)], axis=-1)


def left_bend(x: float, y: float, radius: float) -> np.ndarray:
    angle = np.linspace(0.0, np.pi / 2, round(1.6 * radius) + 1)
    arc = np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=-1)
    return np.array([x, y, 0.0]) + radius * arc


def scenario_of(
    lanes: dict[int, np.ndarray],
    ego: np.ndarray,
    successor: list[tuple[int, int]] | None = None,
    neighbor: list[tuple[int, int]] | None = None,
) -> Scenario:
    """Returns a scenario with lanes by id; without any links there is no lane graph."""
    xyz = np.zeros((1, STEPS, 3))
    at = np.linspace(0, len(ego) - 1, STEPS)
    xyz[0] = np.stack([np.interp(at, np.arange(len(ego)), v) for v in ego.T], axis=-1)
    velocity = np.gradient(xyz[..., :2], 0.1, axis=1)
    yaw = np.arctan2(velocity[..., 1], velocity[..., 0])
    links = None
    if successor is not None or neighbor is not None:
        links = parts.lane_links(successor or [], neighbor or [], [], {})
    return by_hand.cars_on(lanes, xyz, yaw, (4.5, 1.8, 1.5), links)


def found(scenario: Scenario) -> list[tuple[np.ndarray, bool]]:
    paths = routes.with_paths(scenario).paths
    assert paths is not None
    return [
        (paths.points_of(i), bool(paths.on_route[i]))
        for i in range(len(paths.on_route))
    ]


FORK = {1: straight(0, 40), 2: straight(40, 120), 3: left_bend(40, 0, 30)}
FORK_LINKS = [(1, 2), (1, 3)]


def test_of_a_fork_the_branch_that_the_log_took_is_on_route() -> None:
    (a, a_on), (b, b_on) = found(scenario_of(FORK, straight(5, 75), FORK_LINKS))
    assert (a_on, b_on) == (True, False)
    np.testing.assert_allclose(a[:, 1], 0.0, atol=ROUNDING)
    assert b[-1, 1] > 20.0


def test_a_path_reaches_thirty_metres_beyond_the_log() -> None:
    (path, _), _ = found(scenario_of(FORK, straight(5, 75), FORK_LINKS))
    assert path[0, 0] <= 5.0
    assert path[-1, 0] == pytest.approx(105.0, abs=1.0)


def test_on_a_lane_of_two_points_a_path_begins_at_the_ego() -> None:
    lanes = {1: np.array([[0.0, 0, 0], [400.0, 0, 0]])}
    for links in (None, []):
        ((path, on_route),) = found(scenario_of(lanes, straight(150, 195), links))
        assert on_route
        # 45 m as the log, and 30 m beyond.
        np.testing.assert_allclose(path[[0, -1], 0], [150.0, 225.0], atol=ROUNDING)


def test_beside_a_sparse_lane_a_change_begins_at_the_ego() -> None:
    lanes = {
        1: np.array([[0.0, 0, 0], [400.0, 0, 0]]),
        2: np.array([[0.0, 6, 0], [400.0, 6, 0]]),  # too far to be a start itself
    }
    paths = found(scenario_of(lanes, straight(150.3, 195), [], [(1, 2)]))
    for path, _ in paths:
        assert path[0, 0] == pytest.approx(150.3, abs=ROUNDING)
    assert {float(path[0, 1]) for path, _ in paths} == {0.0, 6.0}


def test_points_are_half_a_metre_apart() -> None:
    for path, _ in found(scenario_of(FORK, straight(5, 75), FORK_LINKS)):
        gap = np.linalg.norm(np.diff(path, axis=0), axis=1)
        # In a bend of 30 m the chord is shorter than the way along the lane's edges.
        np.testing.assert_allclose(gap, routes.SPACING, atol=1e-3)


def test_joined_ends_give_the_paths_of_the_lane_graph() -> None:
    graph = found(scenario_of(FORK, straight(5, 75), FORK_LINKS))
    ends = found(scenario_of(FORK, straight(5, 75)))
    assert len(graph) == len(ends)
    for (a, a_on), (b, b_on) in zip(graph, ends, strict=True):
        assert a_on == b_on
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    ("successor", "source"), [(FORK_LINKS, "lane_graph"), (None, "lane_ends")]
)
def test_the_source_is_recorded(successor: list | None, source: str) -> None:
    paths = routes.with_paths(scenario_of(FORK, straight(5, 75), successor)).paths
    assert paths is not None and paths.source == source


def test_a_lane_under_a_bridge_is_not_joined() -> None:
    lanes = {1: straight(0, 40), 2: straight(40, 120) + np.array([0, 0, 6])}
    ((path, _),) = found(scenario_of(lanes, straight(5, 25)))
    assert path[-1, 0] <= 40.0


def test_a_lane_change_makes_a_path_along_the_neighbor() -> None:
    lanes = {1: straight(0, 120), 2: straight(0, 120, 6.0)}  # not both at the start
    ego = np.array([[5.0, 0, 0], [30.0, 0, 0], [50.0, 6, 0], [75.0, 6, 0]])
    paths = found(scenario_of(lanes, ego, neighbor=[(1, 2)]))
    ends = sorted((float(path[-1, 1]), on_route) for path, on_route in paths)
    # Two lanes of 3 m aside: too far for either lane alone, so the log is the way.
    assert ends[0] == (0.0, False)
    assert (6.0, False) in ends


def test_changing_to_the_next_lane_stays_on_route() -> None:
    lanes = {i: straight(0, 120, 3.5 * (i - 1)) for i in (1, 2, 3)}
    ego = np.array([[5.0, 0, 0], [30.0, 0, 0], [50.0, 3.5, 0], [75.0, 3.5, 0]])
    links = [(1, 2), (2, 1), (2, 3), (3, 2)]
    paths = found(scenario_of(lanes, ego, neighbor=links))
    ends = {round(float(path[-1, 1]), 3): on_route for path, on_route in paths}
    assert ends == {0.0: True, 3.5: True, 7.0: False}


def test_a_later_change_runs_over_to_the_neighbor() -> None:
    lanes = {1: straight(0, 40), 2: straight(40, 120), 3: straight(40, 120, 6.0)}
    paths = found(scenario_of(lanes, straight(5, 75), [(1, 2)], [(2, 3)]))
    assert [on_route for _, on_route in paths] == [True, False]
    assert paths[1][0][0, 1] == 0.0 and paths[1][0][-1, 1] == 6.0


def test_a_ring_is_followed_round_and_round() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 63)
    ring = 10 * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=-1)
    ego = 10 * np.stack(
        [np.sin(1.5 * angle), 1 - np.cos(1.5 * angle), 0 * angle], axis=-1
    )
    ((path, on_route),) = found(scenario_of({1: ring}, ego, [(1, 1)]))
    assert on_route
    assert len(path) * routes.SPACING == pytest.approx(10 * 3 * np.pi + 30, rel=0.02)


def test_a_grid_of_forks_gives_at_most_32_paths() -> None:
    lanes, links = {}, []
    for i in range(9):
        for j in range(2):
            lanes[2 * i + j] = straight(10 * i, 10 * i + 10, 0.3 * j)
            links += [(2 * i + j, 2 * i + 2), (2 * i + j, 2 * i + 3)]
    paths = found(scenario_of(lanes, straight(2, 50), links))
    assert len(paths) <= routes.MAX_PATHS
    assert any(on_route for _, on_route in paths)


def test_a_cycle_of_points_ends() -> None:
    lanes = {1: straight(0, 10), 2: straight(10, 10), 3: straight(10, 10)}
    paths = found(scenario_of(lanes, straight(2, 9), [(1, 2), (2, 3), (3, 2)]))
    assert sum(on_route for _, on_route in paths) == 1


def test_ids_that_no_lane_has_are_passed_over() -> None:
    plain = found(scenario_of(FORK, straight(5, 75), FORK_LINKS))
    links = [(1, 99), *FORK_LINKS, (98, 1)]
    strange = found(scenario_of(FORK, straight(5, 75), links, [(1, 97)]))
    assert [on for _, on in plain] == [on for _, on in strange]


def test_a_lane_given_twice_makes_one_path() -> None:
    lanes = {1: straight(0, 40), 2: straight(40, 120), 3: straight(40, 120)}
    assert len(found(scenario_of(lanes, straight(5, 75), [(1, 2), (1, 3)]))) == 1


def test_a_parked_ego_has_a_path_ahead() -> None:
    scenario = scenario_of(FORK, np.repeat(straight(5, 5), 2, axis=0), FORK_LINKS)
    jitter = np.random.default_rng(0).normal(scale=0.02, size=(1, STEPS, 3))
    xyz = scenario.tracks.xyz + jitter
    tracks = dataclasses.replace(scenario.tracks, xyz=xyz)
    ((path, on_route),) = found(dataclasses.replace(scenario, tracks=tracks))
    assert on_route
    np.testing.assert_allclose(path[[0, -1], 0], [5.0, 35.0], atol=5 * 0.02)


def test_an_ego_off_the_lanes_follows_its_log() -> None:
    ego = straight(5, 75, 20.0)
    scenario = routes.with_paths(scenario_of(FORK, ego, FORK_LINKS))
    assert scenario.paths is not None and scenario.paths.source == "log"
    ((path, on_route),) = found(scenario_of(FORK, ego, FORK_LINKS))
    assert on_route
    np.testing.assert_allclose(path[[0, -1], 0], [5.0, 105.0], atol=routes.SPACING)


def test_a_lane_the_other_way_is_no_start() -> None:
    scenario = scenario_of({1: straight(120, 0)}, straight(5, 75), [])
    paths = routes.with_paths(scenario).paths
    assert paths is not None and paths.source == "log"


def test_where_no_lane_follows_the_log_its_track_is_on_route() -> None:
    ego = np.concatenate([straight(5, 40), left_bend(40, 0, 20)[1:]])
    lanes = {1: straight(0, 40), 2: straight(40, 120)}
    scenario = scenario_of(lanes, ego, [(1, 2)])
    assert routes.paths_of(scenario).source == "log"
    (log, log_on), (_, ahead_on) = found(scenario)
    assert (log_on, ahead_on) == (True, False)
    assert log[-1, 1] == pytest.approx(20 + routes.BEYOND, abs=1.0)


def test_paths_of_the_record_are_kept() -> None:
    scenario = routes.with_paths(scenario_of(FORK, straight(5, 75), FORK_LINKS))
    assert routes.with_paths(scenario).paths is scenario.paths


def test_a_way_into_the_lane_is_added_behind_its_first_point() -> None:
    (path, _), _ = found(scenario_of(FORK, straight(-3, 75), FORK_LINKS))
    np.testing.assert_allclose(path[0], [-3.0, 0.0, 0.0], atol=ROUNDING)


@pytest.mark.parametrize(
    "path", sorted(REAL.glob("*.json.gz"))[:8] or [None], ids=lambda p: p and p.name
)
def test_on_route_paths_of_real_logs_cover_the_log(path: pathlib.Path | None) -> None:
    if path is None:
        pytest.skip(f"there are no real scenarios under {REAL}")
    for scenario in build.read(path):
        if not isinstance(scenario, Scenario):
            continue
        track = scenario.tracks.xyz[scenario.ego_index]
        track = track[scenario.tracks.valid[scenario.ego_index], :2]
        paths = found(scenario)
        assert any(on_route for _, on_route in paths)
        for points, on_route in paths:
            gap = np.linalg.norm(points[:, None, :2] - track[-1:], axis=-1).min()
            assert not on_route or gap <= routes.FOLLOW_DISTANCE + HALF_SPACING


def test_paths_carry_the_speed_limits_of_their_lanes() -> None:
    lanes = {1: straight(0, 40), 2: straight(40, 80), 3: straight(80, 160)}
    links = parts.lane_links([(1, 2), (2, 3)], [], [], {1: 10.0, 3: 15.0, 9: 30.0})
    scenario = scenario_of(lanes, straight(0, 120), [(1, 2), (2, 3)])
    paths = routes.paths_of(dataclasses.replace(scenario, lane_links=links))
    x = paths.xyz[:, 0]
    # A point where lanes meet belongs to either.
    for low, high, limit in ((0, 39, 10.0), (41, 79, 0.0), (81, 150, 15.0)):
        inside = (x > low) & (x < high)
        assert inside.sum() > 50
        assert (paths.speed_limit[inside] == limit).all()
        assert (paths.is_limited[inside] == (limit > 0)).all()
