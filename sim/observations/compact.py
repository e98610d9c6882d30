"""Observes the world of one object in few numbers, for self-play at high speed.

Three groups: the object itself, the nearest others, and the pieces of the map in the
tiles around it, nearest tiles first. By C++ on CPUs, else in plain JAX.
"""

import dataclasses
import itertools
import math
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import geometry, map_search, ranges
from ..data import packed, tiles
from ..data.bank import Bank
from ..motion import Motion
from ..native import library
from ..records import Record
from ..scenario import EDGES, LANES
from . import describe
from .base import Observation, Observer, Slot, TokenGroup, View
from .ego_frame import LENGTH_UNIT, SIZE_UNIT, SPEED_UNIT, EgoFrame

NUM_FEATURES = 7  # of an object, and of a piece of the map


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompactConfig:
    """How much of the world an object sees."""

    name: Literal["compact"] = "compact"
    num_objects: int = 63
    num_road: int = 200  # pieces of the map
    radius: float = 80.0  # metres beyond which nothing is seen; tiles by their centres

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a count is below 1 or the radius is no positive length.
        """
        ranges.require_at_least(self, num_objects=1, num_road=1)
        if not 0 < self.radius < math.inf:
            raise ValueError(f"radius must be a positive length, got {self.radius}.")


class Others(Record):
    """All objects, as an observer sees them before it turns them into its frame."""

    xy: Float[Array, "objects 2"]  # metres
    direction: Float[Array, "objects 2"]  # the unit vector along the yaw
    speed: Float[Array, " objects"]  # along the yaw [m/s]
    size: Float[Array, "objects 2"]  # length and width [m]
    valid: Bool[Array, " objects"]


class Seen(Record):
    """What an object sees; absent rows are zero."""

    objects: Float[Array, "seen_objects 7"]
    num_objects: Int[Array, ""]
    road: Float[Array, "seen_road 7"]
    num_road: Int[Array, ""]


def compact(config: CompactConfig) -> Observer:
    """Builds the observer."""
    look = library.on_cpu(
        look_natively,
        look_plainly,
        config=config,
        offsets=tile_offsets(config.radius),
    )

    def observe(view: View, number: Int[Array, ""]) -> Observation:
        now = jax.tree.map(lambda leaf: leaf[-1], view.motion)
        others = _others(now, view.object_size)
        seen = look(view.scene.bank, view.scene.index, others, number)
        is_there = now.valid[number]
        ego = jnp.where(is_there, _ego(view, now, others, number), 0.0)
        return {
            "ego": _group(ego[None], is_there),
            "objects": _group(seen.objects, seen.num_objects),
            "road": _group(seen.road, seen.num_road),
        }

    return Observer(0, observe, _describe)


def tile_offsets(radius: float) -> Int[np.ndarray, "tiles 2"]:
    """Returns the tiles around one, as columns and rows from it, nearest first."""
    reach = math.ceil(radius / tiles.TILE)
    around = itertools.product(range(-reach, reach + 1), repeat=2)
    near = [o for o in around if math.hypot(*o) * tiles.TILE <= radius]
    return np.array(sorted(near, key=lambda o: (math.hypot(*o), o)), np.int32)


def look_natively(
    bank: Bank,
    index: Int[Array, ""],
    others: Others,
    number: Int[Array, ""],
    config: CompactConfig,
    offsets: Int[np.ndarray, "tiles 2"],
) -> Seen:
    """Asks the C++ kernel, on CPUs only."""
    count = jax.ShapeDtypeStruct((), jnp.int32)
    call = jax.ffi.ffi_call(
        "drivetrain_compact_views",
        [
            jax.ShapeDtypeStruct((config.num_objects, NUM_FEATURES), jnp.float32),
            count,
            jax.ShapeDtypeStruct((config.num_road, NUM_FEATURES), jnp.float32),
            count,
        ],
        vmap_method="expand_dims",
    )
    seen = call(
        number,
        others.xy,
        others.direction,
        others.speed,
        others.size,
        others.valid,
        offsets,
        *map_search.map_operands(bank, index),
        radius=np.float32(config.radius),
        length_unit=np.float32(LENGTH_UNIT),
        speed_unit=np.float32(SPEED_UNIT),
        size_unit=np.float32(SIZE_UNIT),
    )
    return Seen(*seen)


def look_plainly(
    bank: Bank,
    index: Int[Array, ""],
    others: Others,
    number: Int[Array, ""],
    config: CompactConfig,
    offsets: Int[np.ndarray, "tiles 2"],
) -> Seen:
    """Looks in plain JAX, on any device."""
    direction = others.direction[number]
    yaw = jnp.arctan2(direction[1], direction[0])
    frame = EgoFrame(xy=others.xy[number], yaw=yaw)
    is_there = others.valid[number]
    objects, num_objects = _nearest_objects(config, frame, others, number)
    road, num_road = _road(config, offsets, frame, bank, index)
    num_objects, num_road = (
        jnp.where(is_there, count, 0) for count in (num_objects, num_road)
    )
    return Seen(
        objects=_prefix(objects, num_objects),
        num_objects=num_objects,
        road=_prefix(road, num_road),
        num_road=num_road,
    )


def _nearest_objects(config, frame: EgoFrame, others: Others, number):
    distance = geometry.norm(others.xy - frame.xy[None])
    numbers = jnp.arange(len(distance))
    there = others.valid & (distance <= config.radius) & (numbers != number)
    rank = jnp.argsort(jnp.argsort(jnp.where(there, distance, jnp.inf)))
    chosen = there & (rank < config.num_objects)
    (number,) = jnp.nonzero(chosen, size=config.num_objects, fill_value=0)
    features = [
        frame.place(others.xy[number]),
        geometry.to_frame(others.direction[number], frame.yaw),
        others.speed[number, None] / SPEED_UNIT,
        others.size[number] / SIZE_UNIT,
    ]
    return jnp.concatenate(features, axis=-1), jnp.sum(chosen, dtype=jnp.int32)


def _road(config, offsets, frame: EgoFrame, bank: Bank, index):
    shape = bank.tile_shape[index]
    own = jnp.floor((frame.xy - bank.tile_corner[index]) / tiles.TILE)
    tile = own.astype(jnp.int32)[None] + offsets
    inside = jnp.all((tile >= 0) & (tile < shape[None]), axis=-1)
    place = bank.first_tile[index] + tile[:, 1] * shape[0] + tile[:, 0]
    place = jnp.where(inside, place, 0)
    start = bank.tile_starts[place]
    end = jnp.cumsum(jnp.where(inside, bank.tile_starts[place + 1] - start, 0))
    slot = jnp.arange(config.num_road)
    around = jnp.searchsorted(end, slot, side="right")
    around = jnp.minimum(around, len(offsets) - 1)
    before = jnp.where(around > 0, end[around - 1], 0)
    count = jnp.minimum(end[-1], config.num_road)
    listed = jnp.where(slot < count, start[around] + slot - before, 0)

    first = bank.first_vertex[index]
    piece = first + bank.tile_pieces[first + listed].astype(jnp.int32)
    tag = bank.vertex_tag[piece]
    joined = (tag >= packed.JOINED).astype(jnp.int32)
    begin, finish = (
        bank.centre[index, None, :2] + bank.quantum[index] * bank.vertices[vertex, :2]
        for vertex in (piece, piece + joined)
    )
    half = (finish - begin) / 2
    length = geometry.norm(half)
    kind = tag.astype(jnp.int32) % packed.JOINED
    features = [
        frame.place(begin + half),
        geometry.to_frame(half, frame.yaw) / jnp.maximum(length, 1e-6)[:, None],
        length[:, None] / LENGTH_UNIT,
        jnp.isin(kind, jnp.array(EDGES))[:, None],
        jnp.isin(kind, jnp.array(LANES))[:, None],
    ]
    return jnp.concatenate(features, axis=-1), count


def _prefix(rows, count):
    return jnp.where(jnp.arange(len(rows))[:, None] < count, rows, 0.0)


def _others(now: Motion, object_size) -> Others:
    direction = geometry.direction(now.yaw)
    return Others(
        xy=now.xy,
        direction=direction,
        speed=geometry.dot(now.velocity, direction),
        size=object_size[:, :2],
        valid=now.valid,
    )


def _ego(view: View, now: Motion, others: Others, number) -> Float[Array, " 6"]:
    goal = view.goal.motion
    offset = goal.xy[number] - now.xy[number]
    return jnp.concatenate(
        [
            others.speed[number, None] / SPEED_UNIT,
            others.size[number] / SIZE_UNIT,
            geometry.to_frame(offset, now.yaw[number]) / LENGTH_UNIT,
            goal.speed[number, None] / SPEED_UNIT,
        ]
    )


def _group(rows, count) -> TokenGroup:
    """Returns the group of the rows that are there; the others are zero already."""
    mask = jnp.arange(len(rows)) < count
    return TokenGroup(values=rows[:, None], mask=mask[:, None])


def _describe() -> tuple[Slot, ...]:
    speed, anywhere = f"{SPEED_UNIT:g} m/s", math.inf
    return (
        Slot(group="ego", feature="speed", unit=speed, low=-anywhere, high=anywhere),
        *describe.size("ego"),
        *describe.place("ego", "goal_"),
        Slot(group="ego", feature="goal_speed", unit=speed, low=0.0, high=anywhere),
        *describe.place("objects"),
        *describe.heading("objects"),
        Slot(
            group="objects", feature="speed", unit=speed, low=-anywhere, high=anywhere
        ),
        *describe.size("objects"),
        *describe.place("road", "middle_"),
        *describe.heading("road"),
        Slot(
            group="road",
            feature="half_length",
            unit=f"{LENGTH_UNIT:g} m",
            low=0.0,
            high=anywhere,
        ),
        *describe.kinds("road", ("edge", "lane")),
    )
