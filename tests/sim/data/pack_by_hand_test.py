"""Tests what packing makes of scenarios that are unusual in one respect."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.data import bank, routes
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import LIMIT_QUANTUM, QUANTUM
from drivetrain.sim.scenario import EDGES, Scenario
from drivetrain.sim.scene import Scene
from tests.oracles import geometry
from tests.sim.data import files
from tests.sim.data.packed_views import (
    FLOAT32,
    MAX_OBJECTS,
    POSITION,
    SHAPE,
    SPEED,
    YAW,
    distance,
    in_scene,
    logged,
    source_segments,
    views,
)


def stretched(factor: float) -> Scenario:
    """Returns a scenario whose map is larger: some of its points lie far away."""
    scenario = dataclasses.replace(files.scenario(3), paths=None)
    roads = dataclasses.replace(scenario.roads, xyz=scenario.roads.xyz * factor)
    return routes.with_paths(dataclasses.replace(scenario, roads=roads))


@pytest.mark.parametrize("factor", [4.0, 7.0])
def test_wide_scenarios_read_back_within_a_coarser_quantum(factor):
    (view,) = views([stretched(factor)], PackConfig())
    quantum = view.packed.quantum
    (xyz, wanted), *_, (velocity, wanted_velocity) = logged(view)
    start, end = source_segments(view.source.roads, EDGES)

    assert quantum / QUANTUM in (2.0, 4.0)
    assert np.abs(xyz - wanted).max() <= quantum / 2 + FLOAT32
    assert np.abs(velocity - wanted_velocity).max() < SPEED
    edges = view.segments.valid & np.isin(view.segments.map_type, EDGES)
    found = view.segments.start[edges], view.segments.end[edges]
    assert distance(in_scene(view, end), *found).max() < SHAPE + quantum
    assert distance(found[0], in_scene(view, start), in_scene(view, end)).max() < (
        SHAPE + quantum
    )


def test_the_place_of_a_light_that_was_never_seen_costs_no_precision():
    scenario = files.scenario(1)
    xyz, valid = scenario.lights.xyz.copy(), scenario.lights.valid.copy()
    xyz[1] = 9e4
    valid[1] = False
    lights = dataclasses.replace(scenario.lights, xyz=xyz, valid=valid)

    packed = pack(dataclasses.replace(scenario, lights=lights), PackConfig())

    assert packed.quantum == QUANTUM


def test_a_track_that_is_never_valid_is_left_out():
    scenario = files.scenario(1)
    valid = scenario.tracks.valid.copy()
    valid[1] = False
    tracks = dataclasses.replace(scenario.tracks, valid=valid)

    packed = pack(dataclasses.replace(scenario, tracks=tracks), PackConfig())

    assert len(packed.object_id) == len(scenario.tracks.object_id) - 1
    assert tracks.object_id[1] not in packed.object_id


def limited(source: Scenario) -> Scenario:
    """Returns the scenario with limits along its first path: 10 m/s, none, 13.3."""
    assert source.paths is not None
    limit = np.zeros(len(source.paths.xyz))
    limit[:9], limit[30:] = 10.0, 13.3
    paths = dataclasses.replace(source.paths, speed_limit=limit, is_limited=limit > 0)
    return dataclasses.replace(source, paths=paths)


def test_speed_limits_are_shown_where_paths_have_them():
    source = limited(routes.with_paths(files.scenario(1)))
    (view,) = views([source], PackConfig())
    paths, found = source.paths, view.paths
    assert paths is not None
    own = found.valid & (found.path == 0)
    line = in_scene(view, paths.points_of(0))[:, :2]
    shown = [
        np.linalg.norm(line - start, axis=1).argmin() for start in found.start[own]
    ]

    assert {0, 9, 30} <= set(shown)  # the limit changes there
    assert (found.is_limited[own] == paths.is_limited[shown]).all()
    error = found.speed_limit[own] - paths.speed_limit[shown]
    assert np.abs(error).max() <= LIMIT_QUANTUM / 2


def test_stop_signs_show_which_way_they_stop():
    source = files.scenario(1)
    (packed,) = [pack(source, PackConfig())]
    lane = source.roads.points_of(0)
    place = source.roads.points_of(int(np.argmax(source.roads.map_type == 17)))
    gap, _ = geometry.project(place[0, :2], lane[:, :2])
    assert packed.stop_has_lane.tolist() == [gap <= 15.0]
    near = dataclasses.replace(
        source, roads=dataclasses.replace(source.roads, xyz=source.roads.xyz * 0.05)
    )
    scene = Scene(
        bank=bank.build(
            [one := pack(near, PackConfig())], bank.Sizes.of([one], MAX_OBJECTS)
        ),
        index=jnp.int32(0),
    )
    signs = scene.stop_signs()
    lane = near.roads.points_of(0)[:, :2]
    wanted = geometry.direction_at(place[0, :2] * 0.05, lane)
    assert signs.has_lane.tolist() == [True]
    turn = geometry.wrap_angle(float(signs.yaw[0]) - wanted)
    assert abs(turn) < YAW
    wanted = place[0] * 0.05 - near.origin
    np.testing.assert_allclose(np.asarray(signs.xyz[0]), wanted, atol=POSITION)
