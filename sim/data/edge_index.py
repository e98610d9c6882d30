"""Finds the few pieces of road edge that can be nearest to a point.

Four edge segments in a row make a block. A grid of coarse cells covers the road edges;
a cell with many candidate blocks is split into four, again and again. Each leaf lists
the blocks that can be nearest to any point in it: those whose distance to the leaf's
centre is at most the least such distance plus the leaf's diagonal (and more where
heights differ). Built once per
scenario on the host, looked up in the program.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

BLOCK = 4  # segments
MAX_BLOCKS = 8  # of a leaf
MAX_VERTICES = BLOCK * 2**16  # blocks have numbers of 16 bits
ROOT_CELL = 32.0  # metres
NUM_LEVELS = 6  # cells of 32, 16, 8, 4, 2 and 1 m
MARGIN = 8.0  # metres around the edges that the grid covers
PAIRS_AT_ONCE = 2**18  # of cell and block, at some 100 bytes each
FAR = 25.0  # cells all of whose points are farther from the edges [m] are not split
HEIGHT_BELOW = 1.0  # metres under the lowest candidate edge of a cell, and
HEIGHT_ABOVE = 3.0  # metres over the highest, between which the answer is exact
HEIGHT_WEIGHT = 2.0  # height counts double in the nearest search (W 3.4)
_NOWHERE = 1e9  # metres
_COUNT_BITS = 4  # a leaf is (first << 4 | count), a split cell is -(first child)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class EdgeIndex:
    """The index of one scenario; without edges its arrays are empty."""

    corner: Float[np.ndarray, " 2"]  # least x and y of the grid [m]
    shape: Int[np.ndarray, " 2"]  # root cells along x and y
    nodes: Int[np.ndarray, " nodes"]  # the root cells, row-major, then their children
    blocks: Int[np.ndarray, " candidates"]  # the lists of the leaves
    num_dropped: int  # candidates that did not fit into the list of a smallest cell


def build(
    vertices: Float[np.ndarray, "vertices 3"], joined: Bool[np.ndarray, " vertices"]
) -> EdgeIndex:
    """Builds the index over road edges.

    Where no list overflowed, the answer is exact for points inside the grid that are at
    most `FAR` from an edge and whose height is within `HEIGHT_BELOW` and `HEIGHT_ABOVE`
    of the edges near them.

    Args:
        vertices: of all edges, one after the other [m].
        joined: whether a segment leads from the vertex to the next one.
    """
    if not joined.any():
        empty = np.zeros(0, np.int32)
        return EdgeIndex(
            corner=np.zeros(2),
            shape=np.zeros(2, np.int32),
            nodes=empty,
            blocks=empty,
            num_dropped=0,
        )
    edges = _Blocks.of(vertices, joined)
    corner = np.floor(vertices[:, :2].min(axis=0) - MARGIN)
    extent = vertices[:, :2].max(axis=0) + MARGIN - corner
    shape = np.ceil(extent / ROOT_CELL).astype(np.int32)
    columns, rows = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]))
    grid = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    centre = corner + (grid + 0.5) * ROOT_CELL
    leaves = _Leaves(len(centre))
    cell, block = edges.start_pairs(centre, ROOT_CELL)
    node = np.arange(len(centre))
    for level in range(NUM_LEVELS):
        size = ROOT_CELL / 2**level
        cell, block, distance = edges.prune(centre, cell, block, size)
        first = np.searchsorted(cell, np.arange(len(centre) + 1))
        far = np.minimum.reduceat(distance, first[:-1]) > FAR + size / np.sqrt(2)
        split = (np.diff(first) > MAX_BLOCKS) & ~far & (level < NUM_LEVELS - 1)
        rank = _ranks(cell, distance, first)
        listed = ~split[cell] & (rank < MAX_BLOCKS)
        leaves.num_dropped += int((~split[cell] & ~listed & ~far[cell]).sum())
        leaves.add(node, ~split, cell[listed], block[listed])
        parents = np.flatnonzero(split)
        if not len(parents):
            break
        node = leaves.split(node[parents])
        quadrants = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]]) * size / 4
        centre = (centre[parents, None] + quadrants).reshape(-1, 2)
        cell, block = _hand_down(cell, block, split)
    nodes, blocks = leaves.arrays()
    return EdgeIndex(
        corner=corner,
        shape=shape,
        nodes=nodes,
        blocks=blocks,
        num_dropped=leaves.num_dropped,
    )


def _ranks(cell, distance, first):
    """Returns the place of each pair among those of its cell, the nearest first."""
    order = np.lexsort([distance, cell])
    ranks = np.empty(len(cell), np.int64)
    ranks[order] = np.arange(len(cell)) - first[cell]
    return ranks


def _hand_down(cell, block, split):
    """Gives the pairs of each split cell to its four children, sorted by child."""
    number = np.cumsum(split) - 1
    inside = split[cell]
    child = (4 * number[cell[inside], None] + np.arange(4)).ravel()
    order = np.argsort(child, kind="stable")
    return child[order], np.repeat(block[inside], 4)[order]


class _Leaves:
    """Collects the nodes of the tree; leaves with equal lists share one."""

    def __init__(self, num_roots: int):
        self.num_dropped = 0
        self._nodes = np.zeros(num_roots, np.int32)
        self._leaves: list[np.ndarray] = []
        self._lists: list[np.ndarray] = []  # [leaves, MAX_BLOCKS], filled up with -1

    def add(self, node, is_leaf, cell, block) -> None:
        """Lists blocks of those cells that are leaves; pairs are sorted by cell."""
        counts = np.bincount(cell, minlength=len(node))
        place = np.arange(len(cell)) - np.repeat(np.cumsum(counts) - counts, counts)
        lists = np.full((len(node), MAX_BLOCKS), -1)
        lists[cell, place] = block
        self._leaves.append(node[is_leaf])
        self._lists.append(lists[is_leaf])

    def split(self, parents):
        """Makes four children of each node and returns their numbers."""
        children = len(self._nodes) + np.arange(4 * len(parents))
        self._nodes = np.append(self._nodes, np.zeros(len(children), np.int32))
        self._nodes[parents] = -children[::4]
        return children

    def arrays(self):
        """Returns the nodes and the lists of blocks."""
        lists, number = np.unique(
            np.concatenate(self._lists), axis=0, return_inverse=True
        )
        counts = (lists >= 0).sum(axis=1)
        leaf = (np.cumsum(counts) - counts) << _COUNT_BITS | counts
        nodes = self._nodes.copy()
        nodes[np.concatenate(self._leaves)] = leaf[number]
        return nodes, lists[lists >= 0].astype(np.int32)


@dataclasses.dataclass(frozen=True, eq=False)
class _Blocks:
    """Blocks of segments, with their heights stretched by `HEIGHT_WEIGHT`.

    Axes and segments come first: NumPy is several times faster at long rows. Where a
    block has fewer segments, points far away fill it.
    """

    start: Float[np.ndarray, "3 block blocks"]
    along: Float[np.ndarray, "3 block blocks"]
    inverse_squared: Float[np.ndarray, "block blocks"]  # of the length; 0 for points
    heights: Float[np.ndarray, "blocks 2"]  # least and greatest [m]

    @classmethod
    def of(cls, vertices, joined):
        segment = np.arange(-(-len(vertices) // BLOCK) * BLOCK).reshape(-1, BLOCK).T
        here, there = (np.minimum(segment + i, len(vertices) - 1) for i in (0, 1))
        exists = joined[here] & (segment < len(vertices))
        stretched = (vertices * [1.0, 1.0, HEIGHT_WEIGHT]).T
        start = np.where(exists, stretched[:, here], _NOWHERE)
        along = np.where(exists, stretched[:, there] - stretched[:, here], 0.0)
        ends = np.stack([vertices[here, 2], vertices[there, 2]])
        low = np.where(exists, ends.min(axis=0), np.inf).min(axis=0)
        high = np.where(exists, ends.max(axis=0), -np.inf).max(axis=0)
        return cls(start, along, _inverse(along), np.stack([low, high], axis=1))

    def flat(self):
        """Returns the blocks as seen from above."""
        plane = np.array([1.0, 1.0, 0.0])[:, None, None]
        start, along = self.start * plane, self.along * plane
        return _Blocks(start, along, _inverse(along), self.heights)

    def distance(self, point, block):
        """Returns the distance of each point to its block.

        Args:
            point: x, y and stretched height, each an array that broadcasts with
                `block`.
            block: numbers of blocks.
        """
        least = np.inf
        for segment in range(BLOCK):
            along = [axis[segment][block] for axis in self.along]
            offset = [
                p - axis[segment][block]
                for p, axis in zip(point, self.start, strict=True)
            ]
            share = offset[0] * along[0] + offset[1] * along[1] + offset[2] * along[2]
            share *= self.inverse_squared[segment][block]
            np.clip(share, 0.0, 1.0, out=share)
            x, y, z = (o - share * a for o, a in zip(offset, along, strict=True))
            least = np.minimum(least, x * x + y * y + z * z)
        return np.sqrt(least)

    def start_pairs(self, centre, size):
        """Returns the pairs of root cell and block that planar distances allow."""
        flat = self.flat()
        point = np.array([*centre.T, np.zeros(len(centre))])[..., None]
        relief = np.ptp(self.heights[np.isfinite(self.heights)])
        slack = (HEIGHT_WEIGHT * (relief + HEIGHT_ABOVE)) ** 2 if relief > 0 else 0.0
        block = np.arange(len(self.heights))
        pairs = []
        rows = max(1, PAIRS_AT_ONCE // len(block))
        for first in range(0, len(centre), rows):
            distance = flat.distance(point[:, first : first + rows], block)
            nearest = distance.min(axis=1, keepdims=True)
            cell, near = np.nonzero(distance <= _reach(nearest, size, slack))
            pairs.append((first + cell, near))
        cells, blocks = zip(*pairs, strict=True)
        return np.concatenate(cells), np.concatenate(blocks)

    def prune(self, centre, cell, block, size):
        """Drops the pairs of cell and block in which the block can never be nearest.

        Block i is nearest at a height z only if, for all j, D_i <= D_j there. D_i^2 -
        D_j^2 is linear in z with a slope of 8 (z_j - z_i), so between the heights that
        are tried, half a step h apart at most, it moves by 4 h times the spread of the
        heights at most. Pairs are sorted by cell. Returns what is left, with the least
        distance found.
        """
        first = np.flatnonzero(np.diff(cell, prepend=-1))
        counts = np.diff(first, append=len(cell))
        low = np.minimum.reduceat(self.heights[block, 0], first)
        spread = np.maximum.reduceat(self.heights[block, 1], first) - low
        thickness = spread + HEIGHT_BELOW + HEIGHT_ABOVE
        num_layers = np.ceil(thickness * np.minimum(4 * spread, 1)).clip(1)
        step = thickness / num_layers
        possible = np.zeros(len(cell), bool)
        least = np.full(len(cell), np.inf)
        for layer in range(int(num_layers.max())):
            height = HEIGHT_WEIGHT * (low - HEIGHT_BELOW + (layer + 0.5) * step)
            point = np.array([*centre.T, height])
            active = np.flatnonzero((layer < num_layers)[cell])
            here = cell[active]
            distance = self.distance(point[:, here], block[active])
            starts = np.flatnonzero(np.diff(here, prepend=-1))
            nearest = np.minimum.reduceat(distance, starts)
            reach = _reach(nearest, size, 4 * (step * spread)[here[starts]])
            near = distance <= np.repeat(reach, counts[here[starts]])
            possible[active] |= near
            least[active] = np.minimum(least[active], distance)
        return cell[possible], block[possible], least[possible]


def _inverse(along):
    """Returns one over the squared length, zero for none."""
    squared = (along**2).sum(axis=0)
    return np.where(squared > 0, 1 / np.where(squared > 0, squared, 1.0), 0.0)


def _reach(nearest, size, squared_slack):
    """Returns how far from its centre the nearest block of a cell's points can be."""
    radius = size / np.sqrt(2)
    return radius + np.sqrt((nearest + radius) ** 2 + squared_slack)


def look_up(
    xy: Float[Array, "points 2"],
    corner: Float[Array, " 2"],
    shape: Int[Array, " 2"],
    nodes: Int[Array, " nodes"],
    first_node: Int[Array, ""],
) -> tuple[Int[Array, " points"], Int[Array, " points"]]:
    """Finds the list of blocks of each point; a point off the grid takes the rim's.

    Args:
        xy: where to look [m].
        corner: of the scenario's index.
        shape: of the scenario's index.
        nodes: of all scenarios, one after the other.
        first_node: where the scenario's own nodes begin.

    Returns:
        The place of the first block in the scenario's lists, and how many there are:
        none without edges.
    """
    rim = jnp.maximum(shape * ROOT_CELL - 1e-3, 0.0)
    inside = jnp.clip(xy - corner[None], 0.0, rim[None])
    root = (inside // ROOT_CELL).astype(jnp.int32)
    node = nodes[first_node + root[:, 1] * shape[0] + root[:, 0]]
    for level in range(1, NUM_LEVELS):
        half = (inside // (ROOT_CELL / 2**level)).astype(jnp.int32) % 2
        child = nodes[first_node - node + half[:, 1] * 2 + half[:, 0]]
        node = jnp.where(node < 0, child, node)
    count = jnp.where(shape[0] > 0, node & (2**_COUNT_BITS - 1), 0)
    return node >> _COUNT_BITS, count
