"""Tests the road edge index and the off-road metric against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.geometry import box_corners
from drivetrain.sim.metrics.aggregate import FLAGS
from drivetrain.sim.scene import Scene
from drivetrain.sim.scene_records import Edge
from tests import changes, worlds
from tests.oracles import geometry, metrics as oracle

NUM_POINTS = 300
# Maps may deviate by 3 cm where simplified and 1 cm where rounded [m].
COARSE = 0.05
HEIGHT = 0.3  # metres that points lie above or below the edges around them, at most


@jax.jit
def nearest_edge(scene: Scene, points: Float[Array, "points 3"]) -> Edge:
    """Returns the nearest road edge of each point."""
    return scene.nearest_edge(points)


def island(centre: tuple[float, ...], radius: float, num_points: int) -> np.ndarray:
    """Returns a closed edge with the road around it."""
    angle = -np.linspace(0, 2 * np.pi, num_points)
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    ring[-1] = ring[0]
    return ring + centre


def lane(start: tuple[float, ...], end: tuple[float, ...], bend: float) -> np.ndarray:
    """Returns an edge of many points that winds from one place to another."""
    share = np.linspace(0, 1, 25)[:, None]
    line = (1 - share) * start + share * end
    line[:, :2] += bend * np.sin(3 * np.pi * share) * (0.4, -1)
    return line


ROAD = lane((-40, -8, 0), (40, -6, 0), 3)
BACK = lane((40, 6, 0), (-40, 8, 0), 2)
MAPS = {
    "islands": [island((0, 0, 0), 9, 12), island((22, 5, 0), 4, 5)],
    "pieces": [ROAD[:7], ROAD[6:9], ROAD[8:], BACK[10:], BACK[:11]],
    "free ends": [ROAD[:7], ROAD[8:], BACK],
    "spikes": [
        np.array([(-20.0, 0, 0), (0, 0, 0), (-19, 2, 0), (5, 9, 0), (-10, 9.5, 0)]),
        np.array([(20.0, 0, 0), (4, 0.5, 0), (20, 1, 0)]),
    ],
    "bridge": [
        ROAD,
        BACK,
        lane((-3, -40, 6), (-4, 40, 6.5), 1)[::-1],
        lane((3, -40, 6), (4, 40, 6.5), 1),
    ],
}


@pytest.mark.parametrize("name", MAPS)
def test_signed_distances_are_those_of_the_oracle(name: str) -> None:
    scenario = worlds.with_edges(synthetic.generate(0), MAPS[name])
    edges = worlds.edges_of(scenario)
    scene = worlds.scene(worlds.bank_of([worlds.exact(scenario)]), 0)
    rng = np.random.default_rng(1)
    vertices = np.concatenate(edges)
    spread = rng.choice([0.5, 8.0], (NUM_POINTS, 1)) * (1, 1, 0)
    points = rng.choice(vertices, NUM_POINTS)
    points += rng.normal(0, 1, (NUM_POINTS, 3)) * spread
    points[:, 2] += rng.uniform(-HEIGHT, HEIGHT, NUM_POINTS)
    points = points.astype(np.float32)
    found = nearest_edge(scene, jnp.asarray(points))
    assert found.valid.all()
    signed = np.asarray(found.signed_distance)
    for point, distance in zip(np.float64(points), signed, strict=True):
        near = [
            oracle.signed_distance(point + np.append(nudge, 0), edges)
            for nudge in worlds.NUDGES
        ]
        assert np.abs(near - distance).min() < 2 * worlds.ROUNDING
    assert 0.05 < np.mean(signed > 0) < 0.95


def test_a_bridge_is_told_from_the_road_under_it() -> None:
    scenario = worlds.with_edges(synthetic.generate(0), MAPS["bridge"])
    scene = worlds.scene(worlds.bank_of([worlds.exact(scenario)]), 0)
    places = jnp.array([[10.0, 0, 0.5], [10.0, 0, 6.5], [0, 20.0, 6.5]])
    off = nearest_edge(scene, places).signed_distance > 0
    assert off.tolist() == [False, True, False]


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_leaving_the_road_is_that_of_the_oracle(kind: str) -> None:
    count = 0
    for scenario, moment, measures in worlds.samples(kind):
        edges = worlds.edges_of(scenario)
        after = moment.after
        flagged = np.asarray(measures["offroad"].value) > 0
        np.testing.assert_array_equal(measures["offroad"].valid, after.valid)
        assert not flagged[~np.asarray(after.valid)].any()

        size = np.asarray(moment.object_size, np.float64)
        for i in np.flatnonzero(after.valid):
            xy, yaw, z = np.float64(after.xy[i]), float(after.yaw[i]), after.xyz[i, 2]
            near = (
                geometry.Box(xy + nudge, yaw, *size[i, :2]) for nudge in worlds.NUDGES
            )
            assert any(
                oracle.offroad(box, float(z), edges) == flagged[i] for box in near
            )
        count += flagged.sum()
    assert count > 5  # else the samples prove nothing


def test_a_map_without_edges_has_no_off_road() -> None:
    scenario = worlds.scenarios("generated")[0]
    dot = worlds.with_edges(scenario, [np.zeros((1, 3))])
    bank = worlds.bank_of([worlds.exact(dot)])
    moment = worlds.moment_of(worlds.scene(bank, 0), 30, 0)
    offroad = worlds.measure(moment)["offroad"]
    assert not np.any(offroad.valid)
    np.testing.assert_array_equal(offroad.value, 0)


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_quantised_flags_agree_but_for_near_ties(kind: str) -> None:
    packed = [pack(s, PackConfig(quantize=True)) for s in worlds.scenarios(kind)]
    coarse = worlds.bank_of(packed)
    agree = []
    for _, moment, exact in worlds.samples(kind):
        scene = moment.scene.replace(bank=coarse)
        measures = worlds.measure(moment.replace(scene=scene))
        for name in FLAGS:
            same = np.asarray(exact[name].value == measures[name].value)
            agree.append(same[np.asarray(exact[name].valid)])
        after, size = moment.after, moment.object_size
        differs = exact["offroad"].value != measures["offroad"].value
        for i in np.flatnonzero(np.asarray(differs)):
            corners = box_corners(after.xy[i], after.yaw[i], size[i])
            height = jnp.broadcast_to(after.xyz[i, 2], (4, 1))
            edge = nearest_edge(moment.scene, jnp.concatenate([corners, height], -1))
            assert np.abs(edge.signed_distance).min() < COARSE
    flat = np.concatenate([np.ravel(each) for each in agree])
    assert (~flat).sum() <= max(1, 0.001 * len(flat))  # of few flags, one may differ


@pytest.mark.parametrize("change", changes.CHANGES)
def test_verdicts_are_kept(change: str) -> None:
    changes.assert_kept(change, "offroad", 0)
