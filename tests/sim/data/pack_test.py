"""Tests that a packed scenario, seen through a scene, says what its source says."""

import numpy as np
import pytest

from drivetrain.sim.data import build, routes
from drivetrain.sim.data.pack import PackConfig
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.scenario import EDGES, Scenario
from tests.oracles import geometry
from tests.sim.data import files
from tests.sim.data.packed_views import (
    FLOAT32,
    LENGTH,
    POSITION,
    SHAPE,
    SPEED,
    YAW,
    View,
    distance,
    in_scene,
    logged,
    source_segments,
    views,
)

REAL = (
    "womd/motion_data_one_example.tfrecord",
    "womd/motion_data_one_scenario.tfrecord",
    "womd_json/tfrecord-00005-of-00150_2bd577a009790706.json.gz",
    "womd_json/tfrecord-00009-of-00150_6ece5198f531a353.json.gz",
)


def sources(kind: str) -> list[Scenario]:
    """Returns generated scenarios, or those of real files, with their paths."""
    if kind == "generated":
        return [synthetic.generate(seed) for seed in range(8)]
    if not (files.REAL_DATA / REAL[0]).is_file():
        pytest.skip(files.NO_REAL_DATA)
    found = [one for name in REAL for one in build.read(files.REAL_DATA / name)]
    scenarios = [one for one in found if isinstance(one, Scenario)]
    assert len(scenarios) == len(REAL)
    return [routes.with_paths(scenario) for scenario in scenarios]


@pytest.fixture(scope="module", params=["generated", "real"])
def scenarios(request: pytest.FixtureRequest) -> list[Scenario]:
    return sources(request.param)


@pytest.fixture(scope="module")
def packed_views(scenarios: list[Scenario]) -> list[View]:
    return views(scenarios, PackConfig())


@pytest.fixture(scope="module")
def exact_views(scenarios: list[Scenario]) -> list[View]:
    return views(scenarios[1:4], PackConfig(quantize=False))


def test_poses_read_back_within_a_centimetre_and_a_tenth_of_a_degree(packed_views):
    for view in packed_views:
        (xyz, wanted_xyz), (yaw, wanted_yaw), (speed, wanted_speed) = logged(view)

        assert np.linalg.norm(xyz - wanted_xyz, axis=-1).max() < POSITION
        assert np.abs(np.exp(1j * yaw) - np.exp(1j * wanted_yaw)).max() < YAW
        assert np.abs(speed - wanted_speed).max() < SPEED


def test_unquantised_logs_read_back_within_float32(exact_views):
    for view in exact_views:
        (xyz, wanted_xyz), (yaw, wanted_yaw), (speed, wanted_speed) = logged(view)

        assert np.abs(xyz - wanted_xyz).max() < FLOAT32
        assert np.abs(np.exp(1j * yaw) - np.exp(1j * wanted_yaw)).max() < 1e-6
        np.testing.assert_allclose(speed, wanted_speed, rtol=1e-6)


def test_objects_are_valid_exactly_where_the_source_is(packed_views):
    for view in packed_views:
        wanted = np.zeros(view.log.valid.shape, bool)
        wanted[: view.source.num_steps, : len(view.order)] = view.source.tracks.valid[
            view.order
        ].T

        np.testing.assert_array_equal(view.log.valid, wanted)
        assert not view.log.xyz[~wanted].any() and not view.log.velocity[~wanted].any()


def test_every_object_that_is_ever_valid_keeps_its_id_type_and_size(packed_views):
    for view in packed_views:
        tracks = view.source.tracks
        seen = tracks.object_id[tracks.valid.any(axis=1)]

        assert sorted(view.packed.object_id) == sorted(seen)
        np.testing.assert_array_equal(
            view.packed.object_type, tracks.object_type[view.order]
        )
        np.testing.assert_allclose(
            view.packed.object_size, tracks.size[view.order], rtol=1e-6
        )


def test_the_ego_comes_first_then_marked_objects_then_the_nearest(packed_views):
    for view in packed_views:
        tracks, ego = view.source.tracks, view.source.ego_index
        gap = np.linalg.norm((tracks.xyz - tracks.xyz[ego])[..., :2], axis=-1)
        gap = np.where(tracks.valid & tracks.valid[ego], gap, np.inf).min(axis=1)
        rest = view.order[1:]
        marked = tracks.is_of_interest[rest]

        assert view.order[0] == ego
        assert (np.diff(marked.astype(int)) <= 0).all()
        assert (gap[rest][~marked] == np.sort(gap[rest][~marked])).all()


def test_lights_show_at_each_step_what_the_source_shows(packed_views):
    for view in packed_views:
        lights, num = view.source.lights, len(view.source.lights.lane_id)
        state = view.lights.state[: view.source.num_steps, :num].T
        place = np.swapaxes(view.lights.xyz[: view.source.num_steps, :num], 0, 1)
        wanted = np.broadcast_to(in_scene(view, lights.xyz)[:, None], place.shape)

        np.testing.assert_array_equal(
            view.lights.valid[: view.source.num_steps, :num].T, lights.valid
        )
        assert not view.lights.valid[:, num:].any()
        np.testing.assert_array_equal(state[lights.valid], lights.state[lights.valid])
        np.testing.assert_allclose(
            place[lights.valid], wanted[lights.valid], atol=POSITION
        )


def test_road_edges_lie_where_the_source_has_them_and_nowhere_else(packed_views):
    for view in packed_views:
        start, end = source_segments(view.source.roads, EDGES)
        wanted = in_scene(view, start), in_scene(view, end)
        edges = view.segments.valid & np.isin(view.segments.map_type, EDGES)
        found = view.segments.start[edges], view.segments.end[edges]

        assert distance(wanted[1], *found).max() < SHAPE
        assert distance(np.concatenate(found), *wanted).max() < SHAPE


@pytest.mark.parametrize("kind", [2, 7, 17, 18])
def test_other_features_keep_their_kind_and_shape(packed_views, kind):
    for view in [v for v in packed_views if kind in v.source.roads.map_type][:3]:
        start, end = source_segments(view.source.roads, (kind,))
        of_kind = view.segments.valid & (view.segments.map_type == kind)
        found = view.segments.start[of_kind], view.segments.end[of_kind]

        assert distance(in_scene(view, end)[::5], *found).max() < SHAPE
        assert (
            distance(found[0], in_scene(view, start), in_scene(view, end)).max() < SHAPE
        )


def test_kinds_of_features_are_those_of_the_source(packed_views):
    for view in packed_views:
        kinds = view.segments.map_type[view.segments.valid]

        assert set(kinds) == set(view.source.roads.map_type)


def test_the_unquantised_map_keeps_every_point(exact_views):
    for view in exact_views:
        wanted = in_scene(view, view.source.roads.xyz[::40])
        vertices = view.packed.vertices

        for point in wanted:
            assert np.abs(vertices - point).max(axis=1).min() < FLOAT32


def test_paths_lie_where_the_source_has_them(packed_views):
    for view in packed_views:
        paths, found = view.source.paths, view.paths
        assert paths is not None
        for i, on_route in enumerate(paths.on_route):
            own = found.valid & (found.path == i)
            wanted = in_scene(view, paths.points_of(i))[:, :2]
            gap = distance(wanted, found.start[own], found.end[own])

            assert gap.max() < SHAPE
            assert (found.on_route[own] == on_route).all()


def test_arcs_measure_the_way_along_each_path(packed_views):
    for view in packed_views:
        paths, found = view.source.paths, view.paths
        assert paths is not None
        for i in range(len(paths.on_route)):
            own = found.valid & (found.path == i)
            length = np.linalg.norm(found.end[own] - found.start[own], axis=1)
            whole = np.diff(paths.points_of(i)[:, :2], axis=0)
            whole = np.linalg.norm(whole, axis=1).sum()

            np.testing.assert_allclose(
                np.append(found.arc[own], np.cumsum(length)[-1])[1:],
                np.cumsum(length),
                atol=SHAPE,
            )
            assert np.sum(length) == pytest.approx(whole, rel=LENGTH, abs=SHAPE)


def test_the_ends_of_the_log_are_where_they_project_onto_the_paths(packed_views):
    for view in packed_views:
        ego = view.source.tracks.valid[view.source.ego_index].nonzero()[0]
        track = in_scene(view, view.source.tracks.xyz[view.source.ego_index])
        for i in range(len(view.packed.path_on_route)):
            own = view.paths.valid & (view.paths.path == i)
            line = np.concatenate([view.paths.start[own], view.paths.end[own][-1:]])
            line = line.astype(np.float64)
            for step, arc in zip(ego[[0, -1]], view.paths.log_arc[own][0], strict=True):
                gap, _ = geometry.project(track[step, :2], line)
                at = np.searchsorted(view.paths.arc[own], arc, side="right") - 1
                start, end = line[at], line[at + 1]
                along = (end - start) / np.linalg.norm(end - start)
                place = start + (arc - view.paths.arc[own][at]) * along

                assert np.linalg.norm(track[step, :2] - place) <= gap + POSITION
