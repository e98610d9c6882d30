"""Tests that a scene shows the log and the road edges where they are, and no others."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.data import bank, build, edge_index
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.motion import Motion
from drivetrain.sim.scenario import MapType, Polylines, Scenario
from drivetrain.sim.scene import Scene
from drivetrain.sim.scene_records import Edge, Lights
from tests.oracles import geometry
from tests.sim.data import files

MANY = 1000  # objects: no cap
QUANTISED = 0.01  # metres: half a quantum along each axis, and float32
FLOAT32 = 1e-3  # metres: differences of coordinates of hundreds of metres
CLOSE = 0.05  # metres: nearer, 3 cm of simplification may change the side
STRETCH = np.array([1.0, 1.0, 2.0])  # height counts double (W 3.4)
EXAMPLE = files.REAL_DATA / "womd/motion_data_one_example.tfrecord"


def scene_of(*scenarios: Scenario, index: int = 0) -> Scene:
    """Returns the scene of one of some scenarios."""
    packed = [pack(scenario, PackConfig()) for scenario in scenarios]
    banked = bank.build(packed, bank.Sizes.of(packed, MANY))
    return Scene(bank=jax.tree.map(jnp.asarray, banked), index=jnp.int32(index))


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Returns a scene of 33 steps in a bank of 91."""
    return scene_of(synthetic.generate(0), files.scenario(1, num_steps=33), index=1)


def with_edges(*runs: np.ndarray) -> Scenario:
    """Returns a scenario whose map is these road edges, in the scenario's frame."""
    scenario = files.scenario(0)
    roads = Polylines(
        xyz=np.concatenate(runs) + scenario.origin,
        offset=np.cumsum([0, *map(len, runs)]),
        map_type=np.full(len(runs), MapType.EDGE_BOUNDARY),
        feature_id=np.arange(len(runs)),
    )
    return dataclasses.replace(scenario, roads=roads)


def line(*xy: tuple[float, float], height: float = 0.0) -> np.ndarray:
    """Returns the points of a polyline at one height."""
    return np.array([(x, y, height) for x, y in xy])


@jax.jit
def at_step(scene: Scene, step: jax.Array) -> tuple[Motion, Lights]:
    """Returns the objects and lights of a step."""
    return scene.log_at(step), scene.lights_at(step)


@jax.jit
def nearest(scene: Scene, points: jax.Array) -> Edge:
    """Looks up the nearest edges in one program for all scenes of a size."""
    return scene.nearest_edge(points)


def signed(scene: Scene, *points: tuple[float, float, float]) -> np.ndarray:
    """Returns the signed distance of each point, which must be valid."""
    edge = nearest(scene, jnp.asarray(points, jnp.float32))
    assert np.asarray(edge.valid).all()
    return np.asarray(edge.signed_distance)


@pytest.mark.parametrize("step", [-100, -1, 33, 34, 90, 91, 1000])
def test_nothing_is_valid_outside_the_log(scene, step):
    motion, lights = at_step(scene, jnp.int32(step))

    assert not motion.valid.any() and not lights.valid.any()
    assert not any(np.asarray(leaf).any() for leaf in jax.tree.leaves(motion))


def test_the_last_step_of_the_log_is_in_it(scene):
    assert at_step(scene, jnp.int32(32))[0].valid.any()


def test_the_log_of_an_object_equals_the_log_at_each_step(scene):
    steps = jnp.arange(scene.bank.sizes.num_steps)
    everything = jax.vmap(scene.log_at)(steps)
    log_of = jax.jit(scene.log_of)
    for number in range(scene.bank.sizes.num_objects):
        own = log_of(jnp.int32(number))

        jax.tree.map(
            functools.partial(np.testing.assert_allclose, rtol=0, atol=FLOAT32),
            own,
            jax.tree.map(lambda leaf, i=number: leaf[:, i], everything),
        )


def test_scenes_side_by_side_show_what_each_shows(scene):
    def view(index: jax.Array):
        return Scene(bank=scene.bank, index=index).log_at(jnp.int32(11))

    both = jax.vmap(view)(jnp.arange(2))

    for i in range(2):
        jax.tree.map(
            lambda leaf, wanted, i=i: np.testing.assert_array_equal(leaf[i], wanted),
            both,
            view(jnp.int32(i)),
        )


def test_slots_without_an_object_are_empty(scene):
    empty = ~np.asarray(scene.object_mask)

    assert (~empty).sum() == 5
    assert empty.any()
    assert not np.asarray(scene.object_size)[empty].any()
    assert not np.asarray(scene.object_type)[empty].any()
    assert np.asarray(scene.object_type)[~empty].all()


def test_the_ego_stands_in_the_origin_at_the_current_step(scene):
    motion = scene.log_at(scene.current_step)

    np.testing.assert_allclose(motion.xyz[0], 0.0, atol=QUANTISED)


def test_the_road_lies_to_the_left_of_an_edge():
    scene = scene_of(with_edges(line((0, 0), (20, 0))))

    found = signed(scene, (10, 2, 0), (10, -3, 0), (5, 0.5, 0))

    np.testing.assert_allclose(found, [-2, 3, -0.5], atol=QUANTISED)


@pytest.mark.parametrize("pieces", ["one", "two"])
def test_at_a_corner_both_edges_decide_in_one_piece_or_two(pieces):
    corner = [line((-20, 0), (0, 0)), line((0, 0), (0, 20))]  # the road is inside
    whole = [line((-20, 0), (0, 0), (0, 20))]
    scene = scene_of(with_edges(*(whole if pieces == "one" else corner)))

    found = signed(scene, (3, -4, 0), (0.5, -6, 0), (6, -0.5, 0), (-3, 3, 0))

    wanted = [5, np.hypot(0.5, 6), np.hypot(6, 0.5), -3]
    np.testing.assert_allclose(found, wanted, atol=QUANTISED)


def test_at_an_inner_corner_a_sharp_angle_keeps_its_sides():
    spike = line((-30, 0), (0, 0), (-30, 4))  # the road is the thin wedge
    scene = scene_of(with_edges(spike))

    found = signed(scene, (2, 0, 0), (1, 3, 0), (1, -3, 0), (-15, 1, 0))

    wanted = [2, np.hypot(1, 3), np.hypot(1, 3), -1 / np.hypot(1, 2 / 15)]
    np.testing.assert_allclose(found[:3], wanted[:3], atol=QUANTISED)
    assert found[3] < 0


def test_beyond_an_end_the_last_edge_decides():
    scene = scene_of(with_edges(line((0, 0), (20, 0))))

    found = signed(scene, (23, 4, 0), (23, -4, 0), (-3, 4, 0), (-3, -4, 0))

    np.testing.assert_allclose(found, [-5, 5, -5, 5], atol=QUANTISED)


def star(rng: np.random.Generator) -> np.ndarray:
    """Returns a closed polygon round the origin, with the road inside."""
    num = int(rng.integers(5, 40))
    angle = (np.arange(num) + rng.uniform(0.0, 0.8, num)) * 2 * np.pi / num
    radius = rng.uniform(5.0, 40.0, num)
    xy = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = np.concatenate([xy, xy[:1]])
    return np.concatenate([ring, np.zeros((num + 1, 1))], axis=1)


def is_inside(point: np.ndarray, ring: np.ndarray) -> bool:
    """Tells whether a point lies in a polygon, by counting crossings of a ray."""
    start, end = ring[:-1], ring[1:]
    crosses = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    rise = np.where(crosses, end[:, 1] - start[:, 1], 1.0)
    at = start[:, 0] + (point[1] - start[:, 1]) * (end[:, 0] - start[:, 0]) / rise
    return bool((crosses & (at > point[0])).sum() % 2)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("is_broken", [False, True], ids=["whole", "pieces"])
def test_of_a_closed_edge_the_inside_is_road_and_the_outside_not(seed, is_broken):
    rng = np.random.default_rng(seed)
    ring = star(rng)
    half = len(ring) // 2
    runs = [ring[half:], ring[: half + 1]] if is_broken else [ring]
    scene = scene_of(with_edges(*runs))
    points = rng.uniform([-45, -45, 0], [45, 45, 0], (300, 3))

    found = signed(scene, *points)

    distance = np.array([geometry.project(p[:2], ring[:, :2])[0] for p in points])
    clear = distance > CLOSE
    inside = np.array([is_inside(point, ring) for point in points])
    assert inside.any() and not inside.all()
    np.testing.assert_array_equal(found[clear] < 0, inside[clear])
    np.testing.assert_allclose(np.abs(found), distance, atol=CLOSE)


def test_heights_tell_the_road_on_a_bridge_from_the_one_below():
    below = line((-40, 2), (40, 2))
    above = line((1, 40), (1, -40), height=6.0)
    scene = scene_of(with_edges(below, above))

    found = signed(scene, (0, 0, 0.8), (0, 0, 6.8))

    np.testing.assert_allclose(found, [2, 1], atol=QUANTISED)


def test_without_road_edges_no_distance_is_valid():
    scenario = with_edges(line((0, 0), (20, 0)))
    kinds = np.array([int(MapType.LANE_SURFACE_STREET)])
    roads = dataclasses.replace(scenario.roads, map_type=kinds)

    edge = nearest(
        scene_of(dataclasses.replace(scenario, roads=roads)), jnp.ones((3, 3))
    )

    assert not np.asarray(edge.valid).any()


@jax.jit
def full_lists(scene: Scene, points: jax.Array) -> jax.Array:
    """Tells for which points the index may have dropped an edge."""
    banked: Bank = scene.bank
    _, count = edge_index.look_up(
        points[:, :2],
        banked.index_corner[scene.index],
        banked.index_shape[scene.index],
        banked.index_nodes,
        banked.first_node[scene.index],
    )
    return count == edge_index.MAX_BLOCKS


@pytest.mark.parametrize("source", [0, 1, 2, "real"])
def test_the_edge_near_an_object_is_the_nearest_of_all(source):
    if source == "real" and not EXAMPLE.is_file():
        pytest.skip(files.NO_REAL_DATA)
    scenario = (
        next(iter(build.read(EXAMPLE)))
        if source == "real"
        else synthetic.generate(source)
    )
    scene = scene_of(scenario)
    motion, _ = at_step(scene, jnp.int32(30))
    points = motion.xyz[motion.valid]
    is_full = np.asarray(full_lists(scene, points))
    found = np.abs(signed(scene, *np.asarray(points)))
    segments = jax.tree.map(np.asarray, scene.map_segments())
    is_edge = np.isin(segments.map_type, [14, 15, 16]) & segments.valid
    is_edge &= (segments.start != segments.end).any(axis=1)
    start, end = (x[is_edge].astype(np.float64) for x in (segments.start, segments.end))

    assert not is_full.all()
    for point, distance in zip(
        np.asarray(points, np.float64)[~is_full], found[~is_full], strict=True
    ):
        _, foot = geometry.feet(point * STRETCH, start * STRETCH, end * STRETCH)
        gap = np.linalg.norm(point * STRETCH - foot, axis=1)
        ties = gap <= gap.min() + FLOAT32
        wanted = np.linalg.norm((point - foot / STRETCH)[ties, :2], axis=1)
        is_far = wanted.min() > edge_index.FAR
        assert is_far or np.abs(wanted - distance).min() <= FLOAT32
