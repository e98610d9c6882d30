"""Tests of the generated scenarios, with geometry of their own."""

import dataclasses

import numpy as np
import pytest

from drivetrain.sim.data import synthetic, synthetic_curve, synthetic_experts
from drivetrain.sim.scenario import (
    EDGES,
    LANES,
    LightState,
    MapType,
    ObjectType,
    Scenario,
)

SEEDS = range(30)
DT = 0.1
MAX_ACCELERATION, MAX_CURVATURE = 6.0, 0.3  # the limits of the bicycle
# Metres: arcs of 7 m radius are drawn with edges of 0.5 m (5 mm), and a swerve of
# 2 m/s^2 moves a car 10 mm aside of its velocity within a step.
POSITION_TOLERANCE = 0.02


@pytest.fixture(scope="module")
def scenarios() -> list[Scenario]:
    return [synthetic.generate(seed) for seed in SEEDS]


def corners(xy: np.ndarray, yaw: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Returns the corners of boxes in order round them."""
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)[..., None, :]
    left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)[..., None, :]
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    return (
        xy[..., None, :]
        + signs[:, :1] * size[..., None, :1] * ahead
        + signs[:, 1:] * size[..., None, 1:2] * left
    )


def boxes(scenario: Scenario) -> np.ndarray:
    tracks = scenario.tracks
    size = np.broadcast_to(tracks.size[:, None], tracks.xyz.shape)
    return corners(tracks.xyz[..., :2] - scenario.origin[:2], tracks.yaw, size)


def overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Tells which of two runs of boxes share some point: no edge separates them."""
    apart = np.zeros(len(a), bool)
    for edges in (a, b):
        for k in range(4):
            edge = edges[:, (k + 1) % 4] - edges[:, k]
            outward = np.stack([edge[:, 1], -edge[:, 0]], axis=-1)
            heights = [
                np.einsum("tki,ti->tk", box - edges[:, k : k + 1], outward)
                for box in (a, b)
            ]
            mine, other = heights if edges is a else heights[::-1]
            apart |= other.min(axis=1) >= mine.max(axis=1)
    return ~apart


def ever_overlap(scenario: Scenario, first: int, second: int) -> bool:
    valid = scenario.tracks.valid[first] & scenario.tracks.valid[second]
    box = boxes(scenario)
    return bool(overlap(box[first][valid], box[second][valid]).any())


def beyond_edge(scenario: Scenario, xy: np.ndarray) -> np.ndarray:
    """Returns how far points lie right of the nearest road edge; left is negative."""
    runs = [
        scenario.roads.points_of(i)[:, :2] - scenario.origin[:2]
        for i in range(scenario.roads.num_features)
        if scenario.roads.map_type[i] in EDGES
    ]
    begin = np.concatenate([run[:-1] for run in runs])
    edge = np.concatenate([np.diff(run, axis=0) for run in runs])
    to_point = xy[:, None] - begin
    along = np.sum(to_point * edge, axis=-1) / np.sum(edge**2, axis=-1)
    gap = to_point - np.clip(along, 0, 1)[..., None] * edge
    distance = np.linalg.norm(gap, axis=-1)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(xy))
    normal = np.stack([edge[nearest, 1], -edge[nearest, 0]], axis=-1)
    return distance[rows, nearest] * np.sign(
        np.sum(to_point[rows, nearest] * normal, axis=-1)
    )


def lanes_of(scenario: Scenario) -> list[int]:
    return np.flatnonzero(np.isin(scenario.roads.map_type, LANES)).tolist()


def wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def coast_fails(scenario: Scenario) -> bool:
    """Tells if holding velocity and heading from step 10 on hits something."""
    tracks = scenario.tracks
    time = DT * np.arange(1, 81)[:, None]
    size = np.broadcast_to(tracks.size[0], (80, 3))
    box = corners(time * tracks.velocity[0, 10], np.full(80, tracks.yaw[0, 10]), size)
    if (beyond_edge(scenario, box.reshape(-1, 2)) > 0).any():
        return True
    others, valid = boxes(scenario)[1:, 11:], tracks.valid[1:, 11:]
    return any(
        overlap(box[v], other[v]).any() for other, v in zip(others, valid, strict=True)
    )


def lights_passed(scenario: Scenario) -> np.ndarray:
    """Returns what the lights show whose stop points a front passes in some step."""
    tracks, lights = scenario.tracks, scenario.lights
    xy = tracks.xyz[..., :2]
    heading = np.stack([np.cos(tracks.yaw), np.sin(tracks.yaw)], axis=-1)
    front = xy + tracks.size[:, 0][:, None, None] / 2 * heading
    shown = []
    for light, lane_id in enumerate(lights.lane_id.tolist()):
        lane = scenario.roads.points_of(lane_id - 1)[:, :2]
        # The lanes that begin here are apart 20 points on: which one is taken?
        away = np.where(tracks.valid, np.linalg.norm(xy - lane[20], axis=-1), np.inf)
        takes = away.min(axis=1, keepdims=True) < 1.3
        ahead = (front - lane[0]) @ (lane[1] - lane[0])
        passes = (ahead[:, :-1] < 0) & (ahead[:, 1:] >= 0) & takes
        passes &= np.linalg.norm(front - lane[0], axis=-1)[:, 1:] < 3.0
        shown.append(lights.state[light, np.nonzero(passes & tracks.valid[:, :-1])[1]])
    return np.concatenate(shown) if shown else np.zeros(0, int)


def test_one_seed_gives_one_scenario() -> None:
    first, second = synthetic.generate(42), synthetic.generate(42)
    for part in ("tracks", "roads", "lights", "lane_links", "paths"):
        a, b = getattr(first, part), getattr(second, part)
        for field in dataclasses.fields(a):
            np.testing.assert_array_equal(
                getattr(a, field.name), getattr(b, field.name), err_msg=field.name
            )


def test_seeds_give_different_scenarios(scenarios: list[Scenario]) -> None:
    assert len({scenario.origin.tobytes() for scenario in scenarios}) == len(SEEDS)


def test_the_id_names_seed_and_kind() -> None:
    config = synthetic.SyntheticConfig(kinds=("curve",))
    assert synthetic.generate(42, config).scenario_id == "synthetic-000042-curve"


def test_the_log_has_91_steps_with_the_ego_in_each(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.num_steps == 91
        assert scenario.tracks.valid[scenario.ego_index].all()


def test_there_are_four_to_twenty_others(scenarios: list[Scenario]) -> None:
    counts = [len(scenario.tracks.object_id) - 1 for scenario in scenarios]
    assert min(counts) >= 4 and max(counts) <= 20


def test_all_kinds_of_road_users_occur(scenarios: list[Scenario]) -> None:
    kinds = np.concatenate([scenario.tracks.object_type for scenario in scenarios])
    expected = {ObjectType.VEHICLE, ObjectType.PEDESTRIAN, ObjectType.CYCLIST}
    assert set(kinds.tolist()) == expected


def test_boxes_that_overlap_are_found() -> None:
    at = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.1]])
    size = np.array([[4.0, 2.0, 1.0]] * 3)
    still = corners(np.zeros((3, 2)), np.zeros(3), size)
    turned = corners(at, np.array([0.3, 0.0, np.pi / 2]), size)
    np.testing.assert_array_equal(overlap(still, turned), [True, True, False])


def test_nobody_ever_overlaps_another(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        num = len(scenario.tracks.object_id)
        for i in range(num):
            for j in range(i):
                assert not ever_overlap(scenario, i, j), (scenario.scenario_id, i, j)


def test_no_corner_of_the_ego_leaves_the_road(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        box = boxes(scenario)[scenario.ego_index].reshape(-1, 2)
        assert (beyond_edge(scenario, box) < 0).all(), scenario.scenario_id


def test_the_road_is_on_the_left_of_each_edge(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        tracks = scenario.tracks
        on_wheels = (tracks.object_type != ObjectType.PEDESTRIAN)[:, None]
        xy = tracks.xyz[tracks.valid & on_wheels][::7, :2] - scenario.origin[:2]
        assert (beyond_edge(scenario, xy) < 0).all(), scenario.scenario_id


def test_the_ego_moves_as_a_bicycle_can(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        velocity = scenario.tracks.velocity[scenario.ego_index]
        speed = np.linalg.norm(velocity, axis=-1)
        acceleration = np.diff(speed) / DT
        assert np.abs(acceleration).max() < MAX_ACCELERATION
        distance = (speed[1:] + speed[:-1]) / 2 * DT
        turned = np.abs(wrapped(np.diff(scenario.tracks.yaw[scenario.ego_index])))
        assert (turned <= MAX_CURVATURE * distance).all(), scenario.scenario_id


def test_the_velocity_points_along_the_yaw(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        tracks = scenario.tracks
        speed = np.linalg.norm(tracks.velocity, axis=-1)
        heading = np.stack([np.cos(tracks.yaw), np.sin(tracks.yaw)], axis=-1)
        np.testing.assert_allclose(
            tracks.velocity, speed[..., None] * heading, atol=1e-9
        )


def test_the_ego_goes_where_its_velocity_says(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        xy = scenario.tracks.xyz[scenario.ego_index, :, :2]
        velocity = scenario.tracks.velocity[scenario.ego_index]
        acceleration = np.diff(velocity, axis=0) / DT
        expected = velocity[:-1] * DT + acceleration * DT**2 / 2
        gap = np.diff(xy, axis=0) - expected
        assert np.abs(gap).max() < POSITION_TOLERANCE


def test_coasting_fails_in_most_scenarios(scenarios: list[Scenario]) -> None:
    assert np.mean([coast_fails(scenario) for scenario in scenarios]) >= 0.6


def test_most_egos_move_and_few_stand(scenarios: list[Scenario]) -> None:
    speed = np.array([np.linalg.norm(s.tracks.velocity[0, 10]) for s in scenarios])
    assert np.mean((speed > 5) & (speed < 14)) > 0.6
    assert np.mean(speed < 0.5) <= 0.2


def test_lanes_begin_where_the_lane_before_ends(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.lane_links is not None
        for before, after in (scenario.lane_links.successor - 1).tolist():
            a, b = scenario.roads.points_of(before), scenario.roads.points_of(after)
            np.testing.assert_allclose(a[-1], b[0], atol=1e-6)
            assert (a[-1] - a[-2]) @ (b[1] - b[0]) > 0


def test_neighbors_run_one_lane_width_apart(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.lane_links is not None
        for lane, beside in (scenario.lane_links.neighbor - 1).tolist():
            a, b = scenario.roads.points_of(lane), scenario.roads.points_of(beside)
            width = np.linalg.norm(a[len(a) // 2, :2] - b[:, :2], axis=-1).min()
            assert 3.3 - 0.01 <= width <= 3.7 + 0.01


def test_points_of_lanes_are_half_a_metre_to_a_metre_apart(
    scenarios: list[Scenario],
) -> None:
    for scenario in scenarios:
        for lane in lanes_of(scenario):
            xy = scenario.roads.points_of(lane)[:, :2]
            gap = np.linalg.norm(np.diff(xy, axis=0), axis=-1)
            assert gap.min() > 0.4 and gap.max() < 1.1


def test_lanes_bend_no_tighter_than_seven_metres(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        for lane in lanes_of(scenario):
            edge = np.diff(scenario.roads.points_of(lane)[:, :2], axis=0)
            length = np.linalg.norm(edge, axis=-1)
            turned = wrapped(np.diff(np.arctan2(edge[:, 1], edge[:, 0])))
            assert (np.abs(turned) <= (length[1:] + length[:-1]) / 2 / 7.0).all()


def test_junctions_have_lights_and_crosswalks(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        is_junction = scenario.scenario_id.endswith("junction")
        assert len(scenario.lights.lane_id) == (12 if is_junction else 0)
        crosswalks = np.sum(scenario.roads.map_type == MapType.CROSSWALK)
        assert crosswalks == (4 if is_junction else 0)


def test_nobody_drives_past_a_red_light(scenarios: list[Scenario]) -> None:
    crossings = np.concatenate([lights_passed(scenario) for scenario in scenarios])
    assert len(crossings) > 20
    assert LightState.STOP not in crossings


def test_pedestrians_are_on_the_road_only_while_all_lights_are_red(
    scenarios: list[Scenario],
) -> None:
    num_on_road = 0
    for scenario in scenarios:
        tracks = scenario.tracks
        walks = tracks.valid & (tracks.object_type == ObjectType.PEDESTRIAN)[:, None]
        xy = tracks.xyz[walks][:, :2] - scenario.origin[:2]
        step = np.nonzero(walks)[1]
        on_road = beyond_edge(scenario, xy) < 0
        assert (scenario.lights.state[:, step[on_road]] == LightState.STOP).all()
        assert len(scenario.lights.lane_id) or not on_road.any()
        num_on_road += on_road.sum()
    assert num_on_road > 20


def test_a_fast_driver_stays_behind_a_slow_one() -> None:
    generator = np.random.default_rng(0)
    site = synthetic_curve.site(generator, 91)
    pair = np.ones(2)
    drivers = synthetic_experts.Drivers(
        route=np.zeros(2, int),
        station=np.array([50.0, 30.0]),
        waits=np.zeros(2, bool),
        size=np.array([[4.0, 2.0, 1.5]] * 2),
        is_obstacle=np.ones(2, bool),
        desired_speed=np.array([4.0, 15.0]),
        headway=1.5 * pair,
        acceleration=1.5 * pair,
        braking=2.0 * pair,
        standstill=2.0 * pair,
    )
    lanes = [synthetic_experts.route([site.lanes[0]], (0,))]
    station, speed = synthetic_experts.drive(site, lanes, drivers, generator)
    gap = station[0] - station[1] - 4.0
    assert gap.min() > 2.0
    # At rest with each other, IDM keeps at least s0 + vT.
    assert 2.0 + 1.5 * 4.0 < gap[-1] < 12.0
    assert speed[1, -1] == pytest.approx(4.0, abs=1.0)


def test_the_paths_come_from_the_lane_graph(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.paths is not None
        assert scenario.paths.source == "lane_graph"
        assert scenario.paths.on_route.any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kinds": ("roundabouts",)}, "kinds must be some of curve, junction"),
        ({"kinds": ()}, "kinds must be some of"),
        ({"min_others": 30}, "min_others must be from 3 to max_others, got 30 and 20"),
    ],
)
def test_a_config_that_cannot_be_met_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        synthetic.SyntheticConfig(**arguments)
