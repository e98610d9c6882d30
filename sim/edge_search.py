"""Finds the road-edge segment nearest to a point: by C++ on CPUs, else in plain JAX.

Nearest is meant in (x, y, 2 z). The search returns numbers and has no gradient; the
distance to the segment found is differentiable (see `scene.nearest_edge`).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from . import geometry
from .data import edge_index, packed
from .data.bank import Bank
from .native import library


def nearest_vertices(
    bank: Bank,
    index: Int[Array, ""],
    points: Float[Array, "points 3"],
    valid: Bool[Array, " points"],
) -> Int[Array, " points"]:
    """Returns the vertex at which the nearest edge segment of each point begins.

    Args:
        bank: the scenarios.
        index: which of them.
        points: where to look, in the scenario's frame [m].
        valid: which of the points to look for.

    Returns:
        Numbers of vertices within the scenario; -1 for points that are not valid, and
        where it has no road edge.
    """
    return library.on_cpu(search_natively, search_plainly)(bank, index, points, valid)


def search_natively(
    bank: Bank,
    index: Int[Array, ""],
    points: Float[Array, "points 3"],
    valid: Bool[Array, " points"],
) -> Int[Array, " points"]:
    """Searches by the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_nearest_edges",
        jax.ShapeDtypeStruct(points.shape[:1], jnp.int32),
        vmap_method="expand_dims",
    )
    return call(
        points,
        valid,
        index,
        bank.index_corner,
        bank.index_shape,
        bank.first_node,
        bank.index_nodes,
        bank.first_block,
        bank.index_blocks,
        bank.first_vertex,
        bank.num_edge_vertices,
        bank.vertices,
        bank.vertex_tag,
        bank.centre,
        bank.quantum,
    )


def search_plainly(
    bank: Bank,
    index: Int[Array, ""],
    points: Float[Array, "points 3"],
    valid: Bool[Array, " points"],
) -> Int[Array, " points"]:
    """Searches in plain JAX, on any device."""
    first, count = edge_index.look_up(
        points[:, :2],
        bank.index_corner[index],
        bank.index_shape[index],
        bank.index_nodes,
        bank.first_node[index],
    )
    slot = jnp.arange(edge_index.MAX_BLOCKS)
    listed = slot[None] < count[:, None]
    place = jnp.where(listed, first[:, None] + slot[None], 0)
    row, column = jnp.divmod(place.astype(jnp.uint32), jnp.uint32(packed.LISTED))
    row = bank.first_block[index] + row.astype(jnp.int32)
    block = bank.index_blocks[row, column.astype(jnp.int32)]
    block = jnp.where(listed, block.astype(jnp.int32), 0)
    in_block = jnp.arange(edge_index.BLOCK)
    number = edge_index.BLOCK * block[..., None] + in_block[None, None]
    number = number.reshape(len(points), -1)
    vertex = bank.first_vertex[index] + number
    is_edge = bank.vertex_tag[vertex] >= packed.JOINED
    is_edge &= jnp.repeat(listed, edge_index.BLOCK, axis=-1)
    is_edge &= number < bank.num_edge_vertices[index]

    stretch = jnp.array([1.0, 1.0, edge_index.HEIGHT_WEIGHT])[None, None]
    centre, quantum = bank.centre[index, None, None], bank.quantum[index]
    start = (centre + quantum * bank.vertices[vertex]) * stretch
    end = (centre + quantum * bank.vertices[vertex + 1]) * stretch
    point = points[:, None] * stretch
    share = geometry.nearest_on_segment(point, start, end)
    offset = point - start - share[..., None] * (end - start)
    squared = geometry.dot(offset, offset)
    squared = jnp.where(is_edge & (squared < jnp.inf), squared, jnp.inf)
    nearest = jnp.argmin(squared, axis=-1)
    found = jnp.take_along_axis(number, nearest[:, None], axis=-1)[:, 0]
    return jnp.where(valid & jnp.any(squared < jnp.inf, axis=-1), found, -1)
