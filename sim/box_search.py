"""Finds boxes that overlap, or stand in the way: by C++ on CPUs, else in plain JAX.

The answers are flags and numbers, without a gradient.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from . import geometry
from .native import library
from .records import Record


class Boxes(Record):
    """The boxes of a scene, seen from above."""

    xy: Float[Array, "objects 2"]  # centres [m]
    yaw: Float[Array, " objects"]  # radians
    size: Float[Array, "objects 3"]  # length, width, height [m]
    valid: Bool[Array, " objects"]

    def operands(self) -> tuple[Array, ...]:
        """Returns the boxes as kernels want them."""
        direction = geometry.direction(self.yaw)
        return self.xy, direction, self.size[:, :2] / 2, self.valid


class Contact(Record):
    """What a swept rectangle meets first."""

    distance: Float[Array, ""]  # along the way to the box [m]; infinite without one
    box: Int[Array, ""]  # its number
    chord: Int[Array, ""]  # of the way, on which it is met


def overlaps(boxes: Boxes, number: Int[Array, ""]) -> Bool[Array, ""]:
    """Tells whether a valid box shares area with another one; touching is none."""
    return library.on_cpu(overlaps_natively, overlaps_plainly)(boxes, number)


def overlaps_natively(boxes: Boxes, number: Int[Array, ""]) -> Bool[Array, ""]:
    """Asks the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_overlaps",
        jax.ShapeDtypeStruct((), jnp.bool_),
        vmap_method="expand_dims",
    )
    return call(number, *boxes.operands())


def overlaps_plainly(boxes: Boxes, number: Int[Array, ""]) -> Bool[Array, ""]:
    """Asks in plain JAX, on any device."""
    overlap = geometry.boxes_overlap(
        boxes.xy[number, None],
        boxes.yaw[number, None],
        boxes.size[number, None],
        boxes.xy,
        boxes.yaw,
        boxes.size,
    )
    return boxes.valid[number] & jnp.any(overlap & _others(boxes, number))


def first_contact(
    boxes: Boxes,
    number: Int[Array, ""],
    active: Bool[Array, ""],
    way: Float[Array, "stations 2"],
    chord_length: float,
) -> Contact:
    """Finds the box that an object meets first when it is swept along a way.

    The way is swept by rectangles of the object's width over its chords. The distance
    reaches from the start of the way to the corner of the other box that comes first
    along the chord, and is never less than that to the start of the chord.

    Args:
        boxes: of all objects.
        number: of the object that is swept.
        active: whether to look at all; there is no contact where not.
        way: places at equal distances along the way [m].
        chord_length: the distance between them along the way [m].
    """
    find = library.on_cpu(
        first_contact_natively, first_contact_plainly, chord_length=chord_length
    )
    return find(boxes, number, active, way)


def first_contact_natively(
    boxes: Boxes,
    number: Int[Array, ""],
    active: Bool[Array, ""],
    way: Float[Array, "stations 2"],
    chord_length: float,
) -> Contact:
    """Asks the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_leaders",
        [
            jax.ShapeDtypeStruct((), jnp.float32),
            jax.ShapeDtypeStruct((), jnp.int32),
            jax.ShapeDtypeStruct((), jnp.int32),
        ],
        vmap_method="expand_dims",
    )
    found = call(
        number, active, way, *boxes.operands(), chord_length=np.float32(chord_length)
    )
    return Contact(*found)


def first_contact_plainly(
    boxes: Boxes,
    number: Int[Array, ""],
    active: Bool[Array, ""],
    way: Float[Array, "stations 2"],
    chord_length: float,
) -> Contact:
    """Asks in plain JAX, on any device."""
    start, along = way[:-1], jnp.diff(way, axis=0)
    length = geometry.norm(along)
    width = jnp.broadcast_to(boxes.size[number, 1], length.shape)
    yaw = jnp.arctan2(along[:, 1], along[:, 0])
    hit = geometry.boxes_overlap(
        (start + along / 2)[:, None],
        yaw[:, None],
        jnp.stack([length, width], axis=-1)[:, None],
        boxes.xy[None],
        boxes.yaw[None],
        boxes.size[None],
    )
    corners = geometry.box_corners(boxes.xy, boxes.yaw, boxes.size)
    heading = geometry.direction(yaw)
    ahead = jnp.einsum("jkc,mc->mjk", corners, heading).min(axis=-1)
    ahead = jnp.maximum(ahead - geometry.dot(start, heading)[:, None], 0.0)
    distance = chord_length * jnp.arange(len(start))[:, None] + ahead
    met = hit & _others(boxes, number)[None] & active
    distance = jnp.where(met, distance, jnp.inf)
    chord, box = jnp.unravel_index(jnp.argmin(distance), distance.shape)
    return Contact(distance=distance[chord, box], box=box, chord=chord)


def _others(boxes: Boxes, number: Int[Array, ""]) -> Bool[Array, " objects"]:
    return boxes.valid & (jnp.arange(len(boxes.valid)) != number)
