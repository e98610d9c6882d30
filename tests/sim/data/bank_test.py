"""Tests that a bank shows each scenario as if it were alone."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.data import bank, dealing, inputs
from drivetrain.sim.data.bank import Bank, Sizes
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.scenario import EDGES, Scenario
from drivetrain.sim.scene import Scene
from tests.sim.data import files

MANY = 1000  # objects: no cap
FLOAT32 = 1e-4  # metres: programs of other shapes may round differently


def without_edges(scenario: Scenario) -> Scenario:
    """Returns the scenario with its road edges turned into lines."""
    roads = scenario.roads
    kinds = np.where(np.isin(roads.map_type, EDGES), 7, roads.map_type)
    return dataclasses.replace(
        scenario, roads=dataclasses.replace(roads, map_type=kinds)
    )


@pytest.fixture(scope="module")
def mixed() -> list[Packed]:
    """Returns scenarios of 20 to 91 steps, with and without lights and road edges."""
    sources = [
        files.scenario(0, num_steps=20),
        synthetic.generate(0),
        without_edges(files.scenario(1, num_steps=70)),
        synthetic.generate(1),
        files.scenario(2, num_steps=33),
    ]
    return [pack(source, PackConfig()) for source in sources]


@pytest.fixture(scope="module")
def banked(mixed: list[Packed]) -> Bank:
    return bank.build(mixed, Sizes.of(mixed, MANY))


@jax.jit
def shown(banked: Bank, index: jax.Array, points: jax.Array) -> dict[str, Any]:
    """Returns what a scene shows, step by step where it changes."""
    scene = Scene(bank=banked, index=index)
    steps = jnp.arange(banked.sizes.num_steps)
    return {
        "log": jax.vmap(scene.log_at)(steps),
        "lights": jax.vmap(scene.lights_at)(steps),
        "size": scene.object_size,
        "type": scene.object_type,
        "feasible": scene.goal_feasible,
        "edges": scene.nearest_edge(points),
        "segments": scene.map_segments(),
        "paths": scene.path_segments(),
        "steps": (scene.num_steps, scene.current_step),
    }


def points_of(packed: Packed) -> jax.Array:
    """Returns places all over the map."""
    rng = np.random.default_rng(0)
    xyz = packed.centre + packed.quantum * packed.vertices.astype(np.float32)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    return jnp.asarray(rng.uniform(low, high, (200, 3)), jnp.float32)


def cut_to(found: Any, alone: Any) -> Any:
    """Cuts each array to the shape of another."""
    return jax.tree.map(
        lambda f, a: np.asarray(f)[tuple(map(slice, a.shape))], found, alone
    )


def padding_of(found: Any, alone: Any) -> int:
    """Counts what is valid beyond the shape that a scenario has alone."""
    inside = np.zeros(found.valid.shape, bool)
    inside[tuple(map(slice, alone.valid.shape))] = True
    return int(np.asarray(found.valid)[~inside].sum())


@pytest.mark.parametrize("number", range(5))
def test_a_scenario_looks_the_same_among_others_as_alone(mixed, banked, number):
    own, points = mixed[number], points_of(mixed[number])
    alone = shown(bank.build([own], Sizes.of([own], MANY)), jnp.int32(0), points)
    found = shown(banked, jnp.int32(number), points)

    for name in ("log", "lights", "size", "type", "edges", "steps"):
        jax.tree.map(
            lambda f, a: np.testing.assert_allclose(f, a, rtol=0, atol=FLOAT32),
            cut_to(found[name], alone[name]),
            alone[name],
        )
    for name in ("segments", "paths"):
        for field, wanted in vars(alone[name]).items():
            there = np.asarray(getattr(found[name], field))[found[name].valid]
            wanted = np.asarray(wanted)[alone[name].valid]
            np.testing.assert_allclose(there, wanted, rtol=0, atol=FLOAT32)
    assert padding_of(found["log"], alone["log"]) == 0
    assert padding_of(found["lights"], alone["lights"]) == 0


def test_a_scenario_without_road_edges_has_none_near(mixed, banked):
    edges = shown(banked, jnp.int32(2), points_of(mixed[2]))["edges"]

    assert not edges.valid.any()
    assert (np.asarray(edges.signed_distance) == -np.inf).all()


def test_sizes_are_those_of_the_largest(mixed):
    sizes = Sizes.of(mixed, MANY)

    assert sizes.num_steps == 91
    assert sizes.num_simulated == 80
    assert sizes.num_objects == max(len(one.object_id) for one in mixed)
    assert sizes.num_vertices == max(len(one.vertices) for one in mixed)


@pytest.mark.parametrize("cap", [1, 3])
def test_objects_beyond_the_cap_are_those_that_come_last(mixed, cap):
    capped = bank.build(mixed, Sizes.of(mixed, cap))
    whole = bank.build(mixed, Sizes.of(mixed, MANY))
    for i, own in enumerate(mixed):
        few, all_of_them = (
            shown(one, jnp.int32(i), points_of(own)) for one in (capped, whole)
        )

        assert few["log"].valid.shape == (91, cap)
        jax.tree.map(
            np.testing.assert_array_equal,
            (few["log"], few["size"], few["type"]),
            cut_to(
                tuple(all_of_them[name] for name in ("log", "size", "type")),
                (few["log"], few["size"], few["type"]),
            ),
        )


def test_the_ego_then_marked_then_near_objects_survive_the_cap():
    source = files.scenario(5)
    tracks = source.tracks
    ego = tracks.xyz[source.ego_index]
    gap = np.linalg.norm((tracks.xyz - ego)[..., :2], axis=-1)
    gap = np.where(tracks.valid, gap, np.inf).min(axis=1)
    others = [i for i in (1, 3) if i != source.ego_index]
    near = min(others, key=lambda i: gap[i])

    packed = pack(source, PackConfig())

    assert packed.object_id[0] == tracks.object_id[source.ego_index]
    assert set(packed.object_id[1:3]) == set(tracks.object_id[tracks.is_of_interest])
    assert packed.object_id[3] == tracks.object_id[near]


@pytest.mark.parametrize("dealt", [[[4, 0, 1]], [[0, 2, 4], [1, 3]], [[0], [0], [3]]])
def test_shards_are_banks_of_the_scenarios_dealt_to_them(mixed, dealt):
    sizes = Sizes.of(mixed, MANY)

    sharded = dealing.build_shards(mixed, sizes, dealt)

    for i, numbers in enumerate(dealt):
        wanted = bank.build([mixed[number] for number in numbers], sizes)
        own = jax.tree.map(lambda array, i=i: array[i], sharded)
        jax.tree.map(np.testing.assert_array_equal, cut_to(own, wanted), wanted)


def test_a_scene_of_a_shard_shows_what_the_scenario_shows(mixed, banked):
    sharded = dealing.build_shards(mixed, Sizes.of(mixed, MANY), [[0, 2, 4], [1, 3]])
    second = jax.tree.map(lambda array: array[1], sharded)
    points = points_of(mixed[3])

    found = shown(second, jnp.int32(1), points)
    wanted = shown(banked, jnp.int32(3), points)

    jax.tree.map(
        lambda f, w: np.testing.assert_allclose(f, w, rtol=0, atol=FLOAT32),
        (found["log"], found["edges"], found["lights"]),
        (wanted["log"], wanted["edges"], wanted["lights"]),
    )


def test_a_bank_of_nothing_is_refused(mixed):
    with pytest.raises(ValueError, match="at least one scenario"):
        bank.build([], Sizes.of(mixed, MANY))


def test_steps_of_different_length_are_refused(mixed):
    other = dataclasses.replace(mixed[0], dt=0.2)

    with pytest.raises(ValueError, match=r"different steps: \[0.1, 0.2\]"):
        bank.build([other, mixed[1]], Sizes.of(mixed, MANY))


def test_quantised_and_unquantised_scenarios_do_not_mix(mixed):
    exact = pack(files.scenario(0), PackConfig(quantize=False))

    with pytest.raises(ValueError, match="some scenarios are quantised"):
        bank.build([mixed[0], exact], Sizes.of(mixed, MANY))


SAMPLES = tuple(
    path
    for pattern in ("womd/*.tfrecord", "womd_json/*.json.gz", "nocturne/*.json.gz")
    for path in sorted(files.REAL_DATA.glob(pattern))
)
WOMD_TRAINING = 487_000  # scenarios


@pytest.mark.skipif(not SAMPLES, reason=files.NO_REAL_DATA)
def test_one_device_can_number_the_rows_of_all_of_womd():
    records = inputs.all_records(SAMPLES[::3], PackConfig())
    packed = [record for record in records if isinstance(record, Packed)]

    for kind in bank.TABLES:
        mean = np.mean([one.rows[kind] for one in packed])
        assert mean * WOMD_TRAINING <= bank.MAX_ROWS, kind
