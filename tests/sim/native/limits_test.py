"""Tests kernels with what no scene holds: NaN, wide numbers, indices past the end."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import box_search, edge_search
from drivetrain.sim.box_search import Boxes
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.native import library
from drivetrain.sim.observations import visible_road
from drivetrain.sim.observations.visibility import Cone
from drivetrain.sim.scenario import MapType, Polylines
from tests import worlds

STEP = jnp.int32(20)


@pytest.fixture(autouse=True)
def _kernels() -> None:
    if not library.is_loaded():
        pytest.skip(f"no kernels: {library.load()}")


def boxes(bank: Bank) -> Boxes:
    """Returns the boxes of a scene, twice as long, so that some overlap."""
    scene = worlds.scene(bank, 0)
    now = scene.log_at(STEP)
    return Boxes(now.xy, now.yaw, 2 * scene.object_size, now.valid)


def test_points_that_are_no_numbers_have_no_nearest_edge() -> None:
    bank, nowhere = worlds.bank("generated"), [jnp.nan, jnp.inf, 1e30]
    points = jnp.array([[x, 0.0, 0.0] for x in nowhere], jnp.float32)
    for search in (edge_search.search_plainly, edge_search.search_natively):
        found = jax.jit(search)(bank, jnp.int32(0), points, jnp.ones(3, bool))
        np.testing.assert_array_equal(found, -1)


def test_boxes_that_are_no_numbers_overlap_none() -> None:
    usual = boxes(worlds.bank("generated"))
    lost = usual.replace(xy=usual.xy.at[1].set(jnp.nan))
    for ask in (box_search.overlaps_plainly, box_search.overlaps_natively):
        hits = jax.jit(jax.vmap(ask, in_axes=(None, 0)))(lost, jnp.arange(16))
        assert not hits[1]


def test_numbers_past_the_end_mean_the_last() -> None:
    bank = worlds.bank("generated")
    count = len(bank.first_vertex)
    points = worlds.scene(bank, count - 1).log_at(STEP).xyz
    ask = jax.jit(edge_search.search_natively)
    valid = jnp.ones(len(points), bool)
    last, beyond = (ask(bank, jnp.int32(i), points, valid) for i in (count - 1, 10**8))
    np.testing.assert_array_equal(beyond, last)
    hit = jax.jit(box_search.overlaps_natively)
    several = boxes(bank)
    assert hit(several, jnp.int32(10**8)) == hit(several, jnp.int32(15))


def test_wide_numbers_give_the_same_answers() -> None:
    usual = boxes(worlds.bank("generated"))
    expected = [bool(box_search.overlaps(usual, jnp.int32(i))) for i in range(16)]
    with jax.enable_x64(True):
        wide = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)), usual)
        wide = wide.replace(xy=wide.xy.astype(jnp.float64))
        found = jax.vmap(box_search.overlaps, in_axes=(None, 0))(wide, jnp.arange(16))
        assert wide.xy.dtype == jnp.float64
    assert any(expected) and list(map(bool, found)) == expected


def test_a_polygon_of_one_place_has_no_points() -> None:
    scenario = worlds.scenarios("generated")[0]
    roads = Polylines(
        xyz=np.zeros((2, 3)),
        offset=np.array([0, 2]),
        map_type=np.array([MapType.CROSSWALK]),
        feature_id=np.array([1]),
    )
    bank = worlds.bank_of([worlds.exact(dataclasses.replace(scenario, roads=roads))])
    cone = Cone(xy=jnp.ones(2), yaw=jnp.float32(0), angle=6.0, distance=50.0)
    absent = boxes(bank).replace(valid=jnp.zeros(16, bool))
    for look in (visible_road.visible_plainly, visible_road.visible_natively):
        _, mask = look(worlds.scene(bank, 0), absent, cone, 4)
        assert not np.any(mask)
