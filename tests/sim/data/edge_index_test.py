"""Tests that the index of road edges lists the edge that a search of all would find."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.data import edge_index
from drivetrain.sim.data.edge_index import BLOCK, FAR, MARGIN, MAX_BLOCKS, EdgeIndex
from tests.oracles import geometry

NUM_POINTS = 400
ROUNDING = 1e-3  # metres: points go to the device as float32 at up to 300 m
STRETCH = np.array([1.0, 1.0, 2.0])  # height counts double (W 3.4)
BRIDGE = 6.0  # metres over the road below


@dataclasses.dataclass(frozen=True)
class Edges:
    """Road edges, one after the other."""

    vertices: np.ndarray  # [vertices, 3]
    joined: np.ndarray  # [vertices]

    def distances(self, point: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """Returns the distance of a point to every segment; inf where there is none."""
        start, end = self.vertices, np.roll(self.vertices, -1, axis=0)
        _, foot = geometry.feet(point * stretch, start * stretch, end * stretch)
        distance = np.linalg.norm(point * stretch - foot, axis=1)
        return np.where(self.joined, distance, np.inf)


def joined_runs(*runs: np.ndarray) -> Edges:
    """Puts polylines one after the other."""
    joined = [np.arange(len(run)) < len(run) - 1 for run in runs]
    return Edges(np.concatenate(runs), np.concatenate(joined))


def walk(rng: np.random.Generator, num_points: int, height: float) -> np.ndarray:
    """Returns a curved, sloping polyline through the middle of the map."""
    turn = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0, 0.15, num_points))
    step = rng.uniform(0.5, 8.0, num_points)
    xy = np.cumsum(step[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1), axis=0)
    xy += rng.uniform(-40, 40, 2) - xy[num_points // 2]
    slope = np.linspace(-1.0, 1.0, num_points) * rng.uniform(0, 1.5)
    return np.concatenate([xy, (height + slope)[:, None]], axis=1)


def roads(seed: int) -> Edges:
    """Returns edges on the ground, and in every second map bridges over them."""
    rng = np.random.default_rng(seed)
    heights = [0.0, 0.0, 0.0, BRIDGE, BRIDGE] if seed % 2 else [0.0] * 4
    return joined_runs(*(walk(rng, int(rng.integers(2, 40)), h) for h in heights))


def points_near(edges: Edges, rng: np.random.Generator) -> np.ndarray:
    """Returns points on the grid, within reach of an edge and at a road's height."""
    inside = edges.vertices[rng.integers(len(edges.vertices), size=NUM_POINTS)]
    spread = rng.choice([0.5, 5.0, FAR], NUM_POINTS)[:, None]
    points = inside + np.append(rng.uniform(-1, 1, 2), 0.0) * spread
    points[:, :2] += rng.uniform(-1, 1, (NUM_POINTS, 2)) * spread
    points[:, 2] += rng.uniform(-edge_index.HEIGHT_BELOW, edge_index.HEIGHT_ABOVE)
    low = edges.vertices[:, :2].min(axis=0) - MARGIN + 1.0
    high = edges.vertices[:, :2].max(axis=0) + MARGIN - 1.0
    points = points[((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)]
    flat = np.array([1.0, 1.0, 0.0])
    reach = np.array([edges.distances(point, flat).min() for point in points])
    return points[reach <= FAR]


def listed(index: EdgeIndex, points: np.ndarray) -> list[np.ndarray]:
    """Returns the blocks that the index lists for each point."""
    first, count = edge_index.look_up(
        jnp.asarray(points[:, :2], jnp.float32),
        jnp.asarray(index.corner, jnp.float32),
        jnp.asarray(index.shape),
        jnp.asarray(index.nodes if len(index.nodes) else np.zeros(1, np.int32)),
        jnp.int32(0),
    )
    return [
        index.blocks[i : i + n]
        for i, n in zip(np.asarray(first), np.asarray(count), strict=True)
    ]


def excess(edges: Edges, point: np.ndarray, blocks: np.ndarray) -> float:
    """Returns how much farther the nearest listed edge is than the nearest of all."""
    distance = edges.distances(point, STRETCH)
    segments = (BLOCK * blocks[:, None] + np.arange(BLOCK)).ravel()
    segments = segments[segments < len(distance)]
    return float(distance[segments].min() - distance.min())


@pytest.mark.parametrize("seed", range(8))
def test_the_nearest_edge_is_listed_unless_the_list_is_full(seed):
    edges = roads(seed)
    index = edge_index.build(edges.vertices, edges.joined)
    points = points_near(edges, np.random.default_rng(seed))
    lists = listed(index, points)

    worse = [
        excess(edges, point, blocks) > ROUNDING
        for point, blocks in zip(points, lists, strict=True)
        if len(blocks) < MAX_BLOCKS or index.num_dropped == 0
    ]

    assert len(worse) > 0.5 * len(points) > 50
    assert not any(worse)


def test_lists_are_never_longer_than_the_program_reads():
    edges = roads(1)
    index = edge_index.build(edges.vertices, edges.joined)

    lists = listed(index, points_near(edges, np.random.default_rng(1)))

    assert max(map(len, lists)) <= MAX_BLOCKS


def test_under_a_bridge_and_on_it_the_edges_of_the_level_are_listed():
    ground = np.array([[-50.0, 3, 0], [50, 3, 0]])
    bridge = np.array([[-3.0, -50, BRIDGE], [-3, 50, BRIDGE]])
    pad = np.array([[0.0, 400, 0]])  # keeps the two in blocks of their own
    edges = joined_runs(ground, pad, pad, bridge)
    index = edge_index.build(edges.vertices, edges.joined)
    rng = np.random.default_rng(0)

    for height in (0.0, BRIDGE):
        points = rng.uniform([-6, -6, height - 0.5], [6, 6, height + 1.5], (200, 3))
        for point, blocks in zip(points, listed(index, points), strict=True):
            assert excess(edges, point, blocks) <= ROUNDING


def test_a_point_off_the_grid_gets_the_list_of_the_rim():
    edges = joined_runs(np.array([[0.0, 0, 0], [100, 0, 0]]))
    index = edge_index.build(edges.vertices, edges.joined)
    points = np.array([[-1e4, 0, 0], [1e4, 1e4, 0], [50, -1e4, 0]])

    assert all(len(blocks) for blocks in listed(index, points))


def spokes(num_spokes: int) -> Edges:
    """Returns a star: each spoke is a block that begins in the middle."""
    angle = np.arange(num_spokes) * 2 * np.pi / num_spokes
    ray = np.array([0.0, 5, 10, 15])[:, None]
    heading = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return joined_runs(*(0.5 + ray * one for one in heading))


def test_what_does_not_fit_into_a_smallest_cell_is_counted():
    fitting, crowded = spokes(MAX_BLOCKS), spokes(MAX_BLOCKS + 1)

    assert edge_index.build(fitting.vertices, fitting.joined).num_dropped == 0
    assert edge_index.build(crowded.vertices, crowded.joined).num_dropped > 0


def test_of_too_many_edges_the_nearest_ones_stay():
    edges = spokes(3 * MAX_BLOCKS)
    index = edge_index.build(edges.vertices, edges.joined)
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-3, 3, (200, 2)), np.zeros((200, 1))], axis=1)
    cell = np.sqrt(2.0)  # metres: the diagonal of a smallest cell

    for point, blocks in zip(points, listed(index, points), strict=True):
        assert excess(edges, point, blocks) <= cell


@pytest.mark.parametrize("num_vertices", [0, 1, 5])
def test_without_edges_nothing_is_listed(num_vertices):
    index = edge_index.build(np.zeros((num_vertices, 3)), np.zeros(num_vertices, bool))

    assert index.num_dropped == 0
    assert [len(b) for b in listed(index, np.array([[3.0, -4, 0], [0, 0, 0]]))] == [
        0,
        0,
    ]


def test_wide_maps_that_are_searched_in_parts_are_listed_alike(monkeypatch):
    edges = roads(0)
    whole = edge_index.build(edges.vertices, edges.joined)
    monkeypatch.setattr(edge_index, "PAIRS_AT_ONCE", 1)
    parts = edge_index.build(edges.vertices, edges.joined)
    for name in ("corner", "shape", "nodes", "blocks"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
