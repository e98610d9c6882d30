"""Tests of whole generated scenarios, with geometry of their own."""

import dataclasses

import numpy as np
import pytest

from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.scenario import (
    DRIVING_LANES,
    EDGES,
    LANES,
    MapType,
    ObjectType,
    Scenario,
)
from tests.oracles import logs

SEEDS = range(20)
DT = 0.1
MAX_ACCELERATION, MAX_CURVATURE = 6.0, 0.3  # the limits of the bicycle
# Metres: arcs of 6 m radius are drawn with edges of 0.8 m, and a swerve of 2 m/s^2
# moves a car 10 mm aside of its velocity within a step.
POSITION_TOLERANCE = 0.04
GRID = 2.0**-16  # metres: what positions are rounded to


@pytest.fixture(scope="module")
def scenarios() -> list[Scenario]:
    return [synthetic.generate(seed) for seed in SEEDS]


def lanes_of(scenario: Scenario) -> list[int]:
    return np.flatnonzero(np.isin(scenario.roads.map_type, LANES)).tolist()


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


@pytest.mark.parametrize("kind", ["road", "junction", "roundabout", "ramp", "carpark"])
def test_the_id_names_seed_and_kind(kind: str) -> None:
    config = synthetic.SyntheticConfig(kinds=(kind,))
    assert synthetic.generate(42, config).scenario_id == f"synthetic-000042-{kind}"


def test_the_log_has_91_steps_with_the_ego_in_each(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.num_steps == 91
        assert scenario.tracks.valid[scenario.ego_index].all()


def test_the_others_are_the_nearest_up_to_the_limit() -> None:
    whole = synthetic.generate(1)
    few = synthetic.generate(1, synthetic.SyntheticConfig(max_others=5))
    assert len(few.tracks.object_id) == 6 < len(whole.tracks.object_id)
    gap = whole.tracks.xyz[..., :2] - whole.tracks.xyz[:1, :, :2]
    nearest = np.where(whole.tracks.valid, np.linalg.norm(gap, axis=-1), np.inf)
    kept = np.sort(np.argsort(nearest.min(axis=1), kind="stable")[:6])
    np.testing.assert_array_equal(few.tracks.xyz, whole.tracks.xyz[kept])


def test_all_kinds_of_road_users_occur(scenarios: list[Scenario]) -> None:
    kinds = np.concatenate([scenario.tracks.object_type for scenario in scenarios])
    expected = {ObjectType.VEHICLE, ObjectType.PEDESTRIAN, ObjectType.CYCLIST}
    assert set(kinds.tolist()) == expected


def test_boxes_that_overlap_are_found() -> None:
    at = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.1]])
    size = np.array([[4.0, 2.0, 1.0]] * 3)
    still = logs.corners(np.zeros((3, 2)), np.zeros(3), size)
    turned = logs.corners(at, np.array([0.3, 0.0, np.pi / 2]), size)
    np.testing.assert_array_equal(logs.overlap(still, turned), [True, True, False])


def test_nobody_ever_overlaps_another(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert not logs.overlapping_pairs(scenario), scenario.scenario_id


def test_no_corner_of_the_ego_leaves_the_road(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        box = logs.boxes(scenario)[scenario.ego_index].reshape(-1, 2)
        assert (logs.beyond_edge(scenario, box) < 0).all(), scenario.scenario_id


def test_the_road_is_on_the_left_of_each_edge(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        points = [
            scenario.roads.points_of(lane)[2:-2:9, :2]
            for lane in lanes_of(scenario)
            if scenario.roads.map_type[lane] in DRIVING_LANES
        ]
        xy = np.concatenate(points) - scenario.origin[:2]
        assert (logs.beyond_edge(scenario, xy) < -0.5).all(), scenario.scenario_id


def test_the_ego_moves_as_a_bicycle_can(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        velocity = scenario.tracks.velocity[scenario.ego_index]
        speed = np.linalg.norm(velocity, axis=-1)
        acceleration = np.diff(speed) / DT
        assert np.abs(acceleration).max() < MAX_ACCELERATION
        distance = (speed[1:] + speed[:-1]) / 2 * DT
        turn = logs.wrapped(np.diff(scenario.tracks.yaw[scenario.ego_index]))
        # A car that hardly moves turns by what its place is rounded to.
        limit = MAX_CURVATURE * distance + 2 * GRID
        assert (np.abs(turn) <= limit).all(), scenario.scenario_id


def test_the_velocity_of_the_ego_points_along_its_yaw(
    scenarios: list[Scenario],
) -> None:
    for scenario in scenarios:
        velocity = scenario.tracks.velocity[scenario.ego_index]
        yaw = scenario.tracks.yaw[scenario.ego_index]
        speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
        heading = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        # Both are rounded to the grid, at up to 32 m/s.
        np.testing.assert_allclose(velocity, speed * heading, atol=32 * GRID)


def test_the_ego_goes_where_its_velocity_says(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        xy = scenario.tracks.xyz[scenario.ego_index, :, :2]
        velocity = scenario.tracks.velocity[scenario.ego_index]
        gap = np.diff(xy, axis=0) - (velocity[1:] + velocity[:-1]) / 2 * DT
        assert np.abs(gap).max() < POSITION_TOLERANCE


def test_what_stands_is_exactly_constant(scenarios: list[Scenario]) -> None:
    num_standing = 0
    for scenario in scenarios:
        tracks = scenario.tracks
        stands = tracks.valid & (tracks.velocity == 0).all(axis=-1)
        stands = stands[:, 1:] & stands[:, :-1]
        assert (np.diff(tracks.xyz, axis=1)[stands] == 0).all()
        assert (np.diff(tracks.yaw, axis=1)[stands] == 0).all()
        num_standing += stands.sum()
    assert num_standing > 91 * len(scenarios)


def test_lanes_begin_exactly_where_the_lane_before_ends(
    scenarios: list[Scenario],
) -> None:
    for scenario in scenarios:
        assert scenario.lane_links is not None
        for before, after in (scenario.lane_links.successor - 1).tolist():
            a, b = scenario.roads.points_of(before), scenario.roads.points_of(after)
            np.testing.assert_array_equal(a[-1], b[0])
            cosine = (a[-1] - a[-2])[:2] @ (b[1] - b[0])[:2]
            cosine /= np.linalg.norm((a[-1] - a[-2])[:2])
            cosine /= np.linalg.norm((b[1] - b[0])[:2])
            assert cosine > 0.97, (scenario.scenario_id, before, after)


def test_neighbors_run_the_same_way_at_most_a_lane_width_apart(
    scenarios: list[Scenario],
) -> None:
    for scenario in scenarios:
        assert scenario.lane_links is not None
        for lane, beside in (scenario.lane_links.neighbor - 1).tolist():
            a, b = (scenario.roads.points_of(i)[:, :2] for i in (lane, beside))
            middle = len(a) // 2
            gap = np.linalg.norm(a[middle] - b, axis=-1)
            assert gap.min() <= 3.75 + 0.01
            near = min(int(np.argmin(gap)), len(b) - 2)
            assert (a[middle + 1] - a[middle]) @ (b[near + 1] - b[near]) > 0


def test_points_of_lanes_are_half_a_metre_to_a_metre_apart(
    scenarios: list[Scenario],
) -> None:
    for scenario in scenarios:
        for lane in lanes_of(scenario):
            xy = scenario.roads.points_of(lane)[:, :2]
            gap = np.linalg.norm(np.diff(xy, axis=0), axis=-1)
            assert gap.min() > 0.3 and gap.max() < 1.2, (scenario.scenario_id, lane)


def test_lights_of_a_junction_control_lanes_where_they_begin(
    scenarios: list[Scenario],
) -> None:
    num_lights = 0
    for scenario in scenarios:
        lights = scenario.lights
        for lane, place in zip(lights.lane_id.tolist(), lights.xyz, strict=True):
            np.testing.assert_array_equal(scenario.roads.points_of(lane - 1)[0], place)
            num_lights += 1
    assert num_lights > 10


def test_stop_signs_lie_at_lanes_that_they_stop(scenarios: list[Scenario]) -> None:
    num_signs = 0
    for scenario in scenarios:
        links = scenario.lane_links
        assert links is not None
        for sign, lane in (links.stop - 1).tolist():
            assert scenario.roads.map_type[sign] == MapType.STOP_SIGN
            place = scenario.roads.points_of(sign)[0]
            gap = scenario.roads.points_of(lane)[0] - place
            assert np.linalg.norm(gap) < 25.0
            num_signs += 1
    assert num_signs > 20


def test_every_lane_has_a_speed_limit(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.lane_links is not None
        limited = set((scenario.lane_links.limited - 1).tolist())
        assert limited == set(lanes_of(scenario))
        assert scenario.lane_links.limit.max() < 31.0


def test_maps_have_edges_all_round(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        edges = np.isin(scenario.roads.map_type, EDGES)
        length = np.diff(scenario.roads.offset)[edges].sum()
        assert length > 200, scenario.scenario_id


def test_the_paths_come_from_the_lane_graph(scenarios: list[Scenario]) -> None:
    for scenario in scenarios:
        assert scenario.paths is not None
        assert scenario.paths.source == "lane_graph", scenario.scenario_id
        assert scenario.paths.on_route.any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kinds": ("curve",)}, "kinds must be some of junction, road, carpark"),
        ({"kinds": ()}, "kinds must be some of"),
        ({"max_others": 0}, "max_others must be at least 1, got 0"),
    ],
)
def test_a_config_that_cannot_be_met_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        synthetic.SyntheticConfig(**arguments)
