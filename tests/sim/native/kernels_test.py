"""Tests that the C++ kernels say what plain JAX says, alone and in batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import AxisType, Mesh, PartitionSpec

from drivetrain.sim import box_search, edge_search, map_search
from drivetrain.sim.box_search import Boxes
from drivetrain.sim.map_search import FlatBox, Reach
from drivetrain.sim.metrics.base import Moment
from drivetrain.sim.native import library
from drivetrain.sim.observations import compact
from drivetrain.sim.scene import Scene
from tests import worlds

pytestmark = pytest.mark.skipif(
    not library.is_loaded(), reason=f"no kernels: {library.load()}"
)
# Pieces that are nearer to each other than this [m] may come in either order: both
# sides round places of up to 1 km in float32 (6e-5 m), by other sequences of
# operations.
TIE = 2e-3
CHORD = 5.0


def moments(kind: str) -> list[Moment]:
    return [sample.moment for sample in worlds.samples(kind)]


def boxes_of(moment: Moment) -> Boxes:
    after = moment.after
    return Boxes(xy=after.xy, yaw=after.yaw, size=moment.object_size, valid=after.valid)


def for_all(ask):
    """Compiles a question about one object of a scene for all of them."""

    def ask_all(shared, *each):
        return jax.vmap(lambda *one: ask(shared, *one))(*each)

    return jax.jit(ask_all)


def numbers(moment: Moment):
    return jnp.arange(len(moment.after.valid))


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_nearest_edges_agree_but_for_ties(kind: str) -> None:
    num_found = 0
    searches = [
        jax.jit(edge_search.search_plainly),
        jax.jit(edge_search.search_natively),
    ]
    signed = jax.jit(jax.vmap(lambda scene, *x: scene._edge(*x), in_axes=(None, 0, 0)))
    for moment in moments(kind):
        scene, points, valid = moment.scene, moment.after.xyz, moment.after.valid
        plain, native = (
            ask(scene.bank, scene.index, points, valid) for ask in searches
        )
        assert np.all(np.asarray(plain)[~np.asarray(valid)] == -1)
        np.testing.assert_array_equal(native >= 0, plain >= 0)
        there = np.asarray(plain) >= 0
        num_found += there.sum()
        distances = [
            np.abs(signed(scene, points, found).signed_distance)[there]
            for found in (plain, native)
        ]
        np.testing.assert_allclose(*distances, atol=TIE)
        assert np.mean(np.asarray(plain) == np.asarray(native)) > 0.8
    assert num_found > 100


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_overlaps_agree(kind: str) -> None:
    num_hits = 0
    asks = [
        for_all(box_search.overlaps_plainly),
        for_all(box_search.overlaps_natively),
    ]
    for moment in moments(kind):
        boxes, number = boxes_of(moment), numbers(moment)
        plain, native = (ask(boxes, number) for ask in asks)
        np.testing.assert_array_equal(native, plain)
        num_hits += int(plain.sum())
    assert num_hits > 10


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_first_contacts_agree(kind: str) -> None:
    num_contacts = 0
    asks = [
        for_all(lambda *x, ask=ask: ask(*x, CHORD))
        for ask in (
            box_search.first_contact_plainly,
            box_search.first_contact_natively,
        )
    ]
    for moment in moments(kind):
        boxes, number = boxes_of(moment), numbers(moment)
        heading = jnp.stack([jnp.cos(boxes.yaw), jnp.sin(boxes.yaw)], axis=-1)
        bent = CHORD * jnp.arange(6.0)[None, :, None] * heading[:, None]
        bent = bent.at[:, 3:, 0].add(2.0)  # a way with a corner
        way = boxes.xy[:, None] + bent
        active = boxes.valid & (number % 5 > 0)
        plain, native = (ask(boxes, number, active, way) for ask in asks)
        met = np.isfinite(plain.distance)
        np.testing.assert_array_equal(np.isfinite(native.distance), met)
        np.testing.assert_array_equal(native.box[met], plain.box[met])
        np.testing.assert_array_equal(native.chord[met], plain.chord[met])
        np.testing.assert_allclose(native.distance[met], plain.distance[met], atol=TIE)
        num_contacts += met.sum()
    assert num_contacts > 10


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize(
    "reach", [Reach(20, 15.0, True), Reach(400, 60.0, True), Reach(50, 40.0, False)]
)
def test_nearest_pieces_agree_but_for_ties(kind, reach) -> None:
    asks = [
        for_all(lambda scene, xy, ask=ask: ask(scene.bank, scene.index, xy, reach))
        for ask in (map_search.nearest_plainly, map_search.nearest_natively)
    ]
    for moment in moments(kind)[::3]:
        scene, xy = moment.scene, moment.after.xy[:6]
        plain, native = (ask(scene, xy) for ask in asks)
        pieces = scene.map_segments()
        start, end = (np.float64(p)[:, :2] for p in (pieces.start, pieces.end))
        for i, point in enumerate(np.float64(xy)):
            distances = []
            for found in (plain, native):
                chosen = np.asarray(found.number[i])[np.asarray(found.valid[i])]
                assert len(set(chosen)) == len(chosen)
                assert np.asarray(pieces.valid)[chosen].all()
                along = end[chosen] - start[chosen]
                square = np.maximum((along**2).sum(-1), 1e-12)
                share = ((point - start[chosen]) * along).sum(-1) / square
                nearest = (
                    start[chosen]
                    + reach.by_segment * np.clip(share, 0, 1)[:, None] * along
                )
                distances.append(np.linalg.norm(nearest - point, axis=-1))
            np.testing.assert_allclose(*distances, atol=TIE)


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("height", [np.inf, 1.0])
def test_edge_contacts_agree(kind: str, height: float) -> None:
    num_touched = 0
    asks = [
        for_all(lambda scene, box, ask=ask: ask(scene.bank, scene.index, box, height))
        for ask in (map_search.touches_plainly, map_search.touches_natively)
    ]
    for moment in moments(kind):
        after = moment.after
        box = FlatBox(xyz=after.xyz, yaw=after.yaw, size=moment.object_size)
        plain, native = (ask(moment.scene, box) for ask in asks)
        np.testing.assert_array_equal(native, plain)
        num_touched += int(plain.sum())
    assert num_touched > 3


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_compact_views_agree(kind: str) -> None:
    config = compact.CompactConfig(num_objects=5, num_road=60, radius=40.0)
    offsets = compact.tile_offsets(config.radius)
    asks = [
        for_all(
            lambda shared, number, look=look: look(
                shared[0].bank, shared[0].index, shared[1], number, config, offsets
            )
        )
        for look in (compact.look_plainly, compact.look_natively)
    ]
    for moment in moments(kind)[:4]:
        others = compact._others(moment.after, moment.object_size)
        plain, native = (ask((moment.scene, others), numbers(moment)) for ask in asks)
        np.testing.assert_array_equal(native.num_objects, plain.num_objects)
        np.testing.assert_array_equal(native.num_road, plain.num_road)
        np.testing.assert_allclose(native.objects, plain.objects, atol=TIE)
        np.testing.assert_allclose(native.road, plain.road, atol=TIE)
        assert int(plain.num_road.max()) == config.num_road


def test_a_batch_over_scenarios_and_objects_equals_a_loop() -> None:
    bank = worlds.bank("generated")
    indices = jnp.arange(4)

    def distances(index):
        scene = Scene(bank=bank, index=index)
        points = scene.log_at(jnp.int32(20)).xyz
        return jax.vmap(lambda point: scene.nearest_edge(point[None]))(points)

    together = jax.jit(jax.vmap(distances))(indices).signed_distance
    for index in indices:
        alone = jax.jit(distances)(index).signed_distance
        np.testing.assert_array_equal(together[index], alone)


def test_kernels_run_inside_shard_map_and_scan() -> None:
    mesh = Mesh(np.array(jax.devices()[:1]), ("data",), axis_types=(AxisType.Auto,))
    bank = jax.tree.map(lambda leaf: leaf[None], worlds.bank("generated"))

    def play(shard):
        bank = jax.tree.map(lambda leaf: leaf[0], shard)

        def step(index, _):
            scene = Scene(bank=bank, index=index)
            edge = scene.nearest_edge(scene.log_at(jnp.int32(20)).xyz)
            return index + 1, edge.signed_distance

        start = jnp.int32(0) * bank.num_scenarios
        return jax.lax.scan(step, start, length=3)[1]

    shards = PartitionSpec("data")
    sharded = jax.shard_map(play, mesh=mesh, in_specs=shards, out_specs=shards)
    np.testing.assert_array_equal(jax.jit(sharded)(bank), jax.jit(play)(bank))


def test_no_gradient_flows_through_a_kernel_and_distances_have_one() -> None:
    scene = moments("generated")[0].scene
    point = scene.log_at(jnp.int32(20)).xyz[:1]
    gradient = jax.grad(lambda p: jnp.sum(scene.nearest_edge(p).signed_distance))(point)
    # Away from vertices the signed distance grows by a metre a metre.
    np.testing.assert_allclose(np.linalg.norm(gradient[0, :2]), 1.0, atol=1e-3)
