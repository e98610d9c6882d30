"""Finds pieces of the map near places: by C++ on CPUs, else in plain JAX.

A piece is a segment of a map feature, or a sign, and has the number of the vertex at
which it begins. The answers are flags and numbers, without a gradient.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from . import geometry
from .data import packed
from .data.bank import Bank
from .native import library
from .records import Record

FAR = 1e9  # metres; off every map, where a search for who is absent ends at once


class Pieces(Record):
    """Pieces of the map by their numbers within the scenario."""

    number: Int[Array, " pieces"]
    valid: Bool[Array, " pieces"]


class Reach(NamedTuple):
    """How many pieces to find, and how far away."""

    num_pieces: int
    radius: float  # beyond which none is found [m]
    by_segment: bool  # whether the distance is that to the segment or to its start


class FlatBox(Record):
    """A box seen from above."""

    xyz: Float[Array, " 3"]  # centre [m]
    yaw: Float[Array, ""]  # radians
    size: Float[Array, " 3"]  # length, width, height [m]


def nearest_pieces(
    bank: Bank, index: Int[Array, ""], xy: Float[Array, " 2"], reach: Reach
) -> Pieces:
    """Finds the pieces of the map that lie nearest to a place, nearest first.

    Args:
        bank: the scenarios.
        index: which of them.
        xy: the place, in the scenario's frame [m].
        reach: how many to find, and how far away.
    """
    find = library.on_cpu(nearest_natively, nearest_plainly, reach=reach)
    return find(bank, index, xy)


def nearest_natively(
    bank: Bank, index: Int[Array, ""], xy: Float[Array, " 2"], reach: Reach
) -> Pieces:
    """Asks the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_nearest_pieces",
        [
            jax.ShapeDtypeStruct((reach.num_pieces,), jnp.int32),
            jax.ShapeDtypeStruct((), jnp.int32),
        ],
        vmap_method="expand_dims",
    )
    number, found = call(
        xy,
        *map_operands(bank, index),
        radius=np.float32(reach.radius),
        by_segment=reach.by_segment,
    )
    return Pieces(number=number, valid=jnp.arange(reach.num_pieces) < found)


def nearest_plainly(
    bank: Bank, index: Int[Array, ""], xy: Float[Array, " 2"], reach: Reach
) -> Pieces:
    """Asks in plain JAX, on any device."""
    first, most = bank.first_vertex[index], bank.sizes.num_vertices
    stored = jax.lax.dynamic_slice_in_dim(bank.vertices, first, most)
    tag = jax.lax.dynamic_slice_in_dim(bank.vertex_tag, first, most)
    joined = tag >= packed.JOINED
    start = bank.centre[index, None, :2] + bank.quantum[index] * stored[:, :2]
    end = jnp.where(joined[:, None], jnp.roll(start, -1, axis=0), start)
    share = geometry.nearest_on_segment(xy[None], start, end)
    share = share if reach.by_segment else jnp.zeros_like(share)
    offset = xy[None] - start - share[:, None] * (end - start)
    squared = geometry.dot(offset, offset)
    is_piece = joined | ~jnp.roll(joined, 1).at[0].set(False)
    near = is_piece & (jnp.arange(most) < bank.num_vertices[index])
    near &= squared <= reach.radius**2
    squared = jnp.where(near, squared, jnp.inf)
    squared = jnp.pad(
        squared, (0, max(reach.num_pieces - most, 0)), constant_values=jnp.inf
    )
    negated, number = jax.lax.top_k(-squared, reach.num_pieces)
    found = jnp.isfinite(negated)
    return Pieces(number=jnp.where(found, number, 0), valid=found)


def touches_edge(
    bank: Bank, index: Int[Array, ""], box: FlatBox, height: float
) -> Bool[Array, ""]:
    """Tells whether a box, seen from above, shares a point with a road edge.

    Args:
        bank: the scenarios.
        index: which of them.
        box: in the scenario's frame.
        height: how far above or below the box the middle of an edge segment may lie
            [m]; infinite to look from above only.
    """
    ask = library.on_cpu(touches_natively, touches_plainly, height=height)
    return ask(bank, index, box)


def touches_natively(
    bank: Bank, index: Int[Array, ""], box: FlatBox, height: float
) -> Bool[Array, ""]:
    """Asks the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_edge_contacts",
        jax.ShapeDtypeStruct((), jnp.bool_),
        vmap_method="expand_dims",
    )
    sides = [geometry.direction(box.yaw), box.size[:2] / 2]
    return call(
        jnp.concatenate([box.xyz, *sides]),
        bank.num_edge_vertices,
        *map_operands(bank, index),
        height=np.float32(height),
    )


def touches_plainly(
    bank: Bank, index: Int[Array, ""], box: FlatBox, height: float
) -> Bool[Array, ""]:
    """Asks in plain JAX, on any device."""
    first, most = bank.first_vertex[index], bank.sizes.num_edge_vertices
    stored = jax.lax.dynamic_slice_in_dim(bank.vertices, first, most + 1)
    tag = jax.lax.dynamic_slice_in_dim(bank.vertex_tag, first, most)
    vertices = bank.centre[index, None] + bank.quantum[index] * stored
    middle = (vertices[:-1] + vertices[1:]) / 2 - box.xyz[None]
    half = (vertices[1:, :2] - vertices[:-1, :2]) / 2
    middle_box = geometry.to_frame(middle[:, :2], box.yaw[None])
    half_box = jnp.abs(geometry.to_frame(half, box.yaw[None]))
    extent = box.size[None, :2] / 2
    inside = jnp.all(jnp.abs(middle_box) <= extent + half_box, axis=-1)
    beside = jnp.abs(geometry.cross(middle[:, :2], half)) <= geometry.dot(
        jnp.broadcast_to(extent, half_box.shape), half_box[:, ::-1]
    )
    is_edge = (tag >= packed.JOINED) & (
        jnp.arange(most) < bank.num_edge_vertices[index]
    )
    level = jnp.abs(middle[:, 2]) <= height
    return jnp.any(is_edge & level & inside & beside)


def map_operands(bank: Bank, index: Int[Array, ""]) -> tuple[Array, ...]:
    """Returns what kernels need of a map, in the order of `map.h`."""
    return (
        index,
        bank.first_tile,
        bank.first_vertex,
        bank.tile_shape,
        bank.tile_starts,
        bank.tile_corner,
        bank.centre,
        bank.tile_reach,
        bank.quantum,
        bank.tile_pieces,
        bank.vertex_tag,
        bank.vertices,
    )
