"""Tests of the vector observation against plain NumPy, and of what must not matter."""

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.observations.base import Observation
from drivetrain.sim.observations.ego_frame import LENGTH_UNIT, SIZE_UNIT, SPEED_UNIT
from drivetrain.sim.observations.noise import NoiseConfig
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.scenario import EDGES
from drivetrain.sim.scene import Scene
from tests import worlds

CONFIG = VectorConfig(
    history=3, num_objects=6, num_road=40, num_lights=4, num_route=8, radius=50.0
)
STEP = 30
# Positions of up to 1 km in float32 (6e-5 m), turned and divided by 20 m.
ROUNDING = 1e-4


@functools.cache
def seen(index: int, kind: str = "generated") -> Observation:
    return observe(worlds.bank(kind), index)


def observe(bank, index: int) -> Observation:
    return look(CONFIG, worlds.scene(bank, index))


@functools.partial(jax.jit, static_argnames="config")
def look(config: VectorConfig, scene: Scene, number: int = 0) -> Observation:
    """Returns what an object sees of the log."""
    motion = jax.vmap(scene.log_at)(jnp.arange(STEP - config.history, STEP + 1))
    view = worlds.view_of(scene, motion, STEP)
    return vector(config).observe(view, jnp.int32(number))


def in_ego_frame(xy: np.ndarray, ego_xy: np.ndarray, ego_yaw: float) -> np.ndarray:
    c, s = np.cos(ego_yaw), np.sin(ego_yaw)
    return (xy - ego_xy) @ np.array([[c, -s], [s, c]])


@pytest.mark.parametrize("index", [0, 1, 2])
def test_objects_are_the_nearest_ones_in_the_pose_of_the_ego(index: int) -> None:
    scenario = worlds.scenarios("generated")[index]
    tracks, ego = scenario.tracks, scenario.ego_index
    xy, yaw = tracks.xyz[ego, STEP, :2], tracks.yaw[ego, STEP]
    distance = np.linalg.norm(tracks.xyz[:, STEP, :2] - xy, axis=1)
    there = tracks.valid[:, STEP] & (distance <= CONFIG.radius)
    there[ego] = False
    expected = np.flatnonzero(there)[np.argsort(distance[there])][: CONFIG.num_objects]

    group = seen(index)["objects"]
    assert int(group.mask[:, -1].sum()) == len(expected)
    for slot, number in enumerate(expected):
        for past in range(CONFIG.history + 1):
            step = STEP - CONFIG.history + past
            assert bool(group.mask[slot, past]) == tracks.valid[number, step]
            if not tracks.valid[number, step]:
                continue
            place = in_ego_frame(tracks.xyz[number, step, :2], xy, yaw) / LENGTH_UNIT
            turn = tracks.yaw[number, step] - yaw
            push = in_ego_frame(tracks.velocity[number, step], np.zeros(2), yaw)
            kind = np.eye(3)[tracks.object_type[number] - 1]
            np.testing.assert_allclose(
                group.values[slot, past],
                np.concatenate(
                    [
                        place,
                        [np.cos(turn), np.sin(turn)],
                        push / SPEED_UNIT,
                        tracks.size[number, :2] / SIZE_UNIT,
                        kind,
                    ]
                ),
                atol=ROUNDING,
            )


@pytest.mark.parametrize("index", [0, 1])
def test_the_road_shows_the_nearest_pieces_of_the_map(index: int) -> None:
    scenario = worlds.scenarios("generated")[index]
    tracks, ego = scenario.tracks, scenario.ego_index
    xy = tracks.xyz[ego, STEP, :2]
    distances, is_edge = [], []
    for feature in range(scenario.roads.num_features):
        points = scenario.roads.points_of(feature)[:, :2]
        for a, b in itertools.pairwise(points):
            length = np.dot(b - a, b - a)
            if length == 0:
                continue
            share = np.clip(np.dot(xy - a, b - a) / length, 0, 1)
            distances.append(np.linalg.norm(a + share * (b - a) - xy))
            is_edge.append(scenario.roads.map_type[feature] in EDGES)
    nearest = np.argsort(distances)[: CONFIG.num_road]

    group = seen(index)["road"]
    assert bool(group.mask.all())
    shown = np.linalg.norm(group.values[:, 0, :2], axis=1) * LENGTH_UNIT
    np.testing.assert_allclose(
        np.sort(shown), np.array(distances)[nearest], atol=ROUNDING * LENGTH_UNIT
    )
    assert int(group.values[:, 0, 8].sum()) == np.sum(np.array(is_edge)[nearest])


def test_the_route_starts_beside_the_ego_and_leads_along_the_log() -> None:
    scenario = worlds.scenarios("generated")[0]
    tracks, ego = scenario.tracks, scenario.ego_index
    group = seen(0)["route"]
    place = np.asarray(group.values[:, 0, :2])[np.asarray(group.mask[:, 0])]
    ahead = in_ego_frame(
        tracks.xyz[ego, STEP:, :2], tracks.xyz[ego, STEP, :2], tracks.yaw[ego, STEP]
    )
    assert np.linalg.norm(place[0]) * LENGTH_UNIT < 2.0
    gaps = np.linalg.norm(np.diff(place, axis=0), axis=1) * LENGTH_UNIT
    # Chords of an arc are shorter than the arc.
    assert np.all(gaps <= CONFIG.route_spacing + ROUNDING * LENGTH_UNIT)
    assert np.all(gaps > 0.9 * CONFIG.route_spacing)
    for xy in ahead[::10]:
        nearest = np.linalg.norm(place * LENGTH_UNIT - xy, axis=1).min()
        reach = np.linalg.norm(place[-1]) * LENGTH_UNIT
        assert nearest < 4.0 or np.linalg.norm(xy) > reach


def test_what_is_masked_is_zero() -> None:
    for index in range(3):
        for group in seen(index).values():
            assert not np.any(np.asarray(group.values)[~np.asarray(group.mask)])


def test_turning_and_shifting_the_map_changes_nothing() -> None:
    scenario = worlds.scenarios("generated")[1]
    other = worlds.turned(scenario, 1.1, np.array([500.0, -300.0, 20.0]))
    bank = worlds.bank_of([worlds.exact(other)])
    for name, group in observe(bank, 0).items():
        before = seen(1)[name]
        np.testing.assert_array_equal(group.mask, before.mask)
        np.testing.assert_allclose(group.values, before.values, atol=10 * ROUNDING)


def test_a_world_with_less_than_fits_is_masked() -> None:
    many = VectorConfig(
        history=1, num_objects=500, num_road=9000, num_lights=300, num_route=4
    )
    observation = look(many, worlds.scene(worlds.bank("generated"), 0))
    assert observation["objects"].values.shape[0] == 500
    assert int(observation["objects"].mask[:, -1].sum()) < 30


def test_the_road_can_be_points_with_their_directions() -> None:
    scenario = worlds.scenarios("generated")[0]
    tracks, ego = scenario.tracks, scenario.ego_index
    xy, yaw = tracks.xyz[ego, STEP, :2], tracks.yaw[ego, STEP]
    rows = []
    for feature in range(scenario.roads.num_features):
        points = scenario.roads.points_of(feature)[:, :2]
        is_edge = scenario.roads.map_type[feature] in EDGES
        pairs = itertools.pairwise(points) if len(points) > 1 else [(points[0],) * 2]
        for a, b in pairs:
            length = np.linalg.norm(b - a)
            along = in_ego_frame(b - a, np.zeros(2), yaw) / (length or 1.0)
            if length > 0 or len(points) == 1:
                rows.append((*in_ego_frame(a, xy, yaw) / LENGTH_UNIT, *along, is_edge))
    nearest = sorted(rows, key=lambda row: row[0] ** 2 + row[1] ** 2)

    config = VectorConfig(history=0, road="points", num_road=30)
    group = look(config, worlds.scene(worlds.bank("generated"), 0))["road"]
    assert bool(group.mask.all())
    shown = np.asarray(group.values)[:, 0, [0, 1, 2, 3, 6]]
    # Points at the same distance may come in any order: each must be a point of the
    # map, and their distances those of the nearest.
    for row in shown:
        assert np.abs(np.array(rows) - row).max(axis=1).min() < 10 * ROUNDING
    np.testing.assert_allclose(
        np.hypot(*shown[:, :2].T),
        [np.hypot(*row[:2]) for row in nearest[:30]],
        atol=ROUNDING,
    )


def test_the_route_is_shown_to_the_ego_alone() -> None:
    config = VectorConfig(history=0, num_road=4)
    scene = worlds.scene(worlds.bank("generated"), 0)
    assert np.any(look(config, scene, 0)["route"].mask)
    for number in (1, 2):
        other = look(config, scene, number)
        assert np.any(other["ego"].mask)
        assert not np.any(other["route"].mask) and not np.any(other["route"].values)


def test_who_is_absent_sees_nothing() -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    config = VectorConfig(history=1, num_road=4, goal=True)
    absent = np.flatnonzero(~np.asarray(worlds.log_at(scene, jnp.int32(STEP)).valid))
    assert len(absent) > 0
    for leaf in jax.tree.leaves(look(config, scene, int(absent[0]))):
        assert not np.any(leaf)


def test_noise_blurs_others_and_the_nearest_are_those_that_seem_so() -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    exact = VectorConfig(history=2, num_road=4, num_objects=6)
    noise = NoiseConfig(position=3.0, yaw=0.1, velocity=1.0)
    noisy = dataclasses.replace(exact, noise=noise)
    before, after = look(exact, scene), look(noisy, scene)
    for name in ("ego", "road", "lights", "route"):
        jax.tree.map(np.testing.assert_array_equal, before[name], after[name])
    place = np.asarray(after["objects"].values[:, -1, :2])
    far = np.linalg.norm(place, axis=-1)[np.asarray(after["objects"].mask[:, -1])]
    assert np.all(np.diff(far) >= 0)
    assert np.abs(place - before["objects"].values[:, -1, :2]).max() > 0.01


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"num_objects": 0}, "num_objects must be at least 1, got 0"),
        ({"num_lights": -1}, "num_lights must be at least 0, got -1"),
        ({"radius": 0.0}, "radius must be a positive length, got 0.0"),
    ],
)
def test_wrong_fields_are_told(fields: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        VectorConfig(**fields)


def test_lights_and_route_can_be_left_out() -> None:
    config = VectorConfig(history=0, num_lights=0, num_route=0)
    observation = look(config, worlds.scene(worlds.bank("generated"), 0))
    assert observation.keys() == {"ego", "objects", "road"}
