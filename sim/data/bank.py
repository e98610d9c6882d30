"""Holds many packed scenarios on a device, and shows them one at a time.

A world does not carry its map: it carries the number of its scenario in the bank. A
`Scene` is a view of one scenario whose accessors gather just what is asked for.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from ..records import Record
from . import log_rows
from .pack import Packed


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sizes:
    """The static sizes of a bank: the largest of its scenarios, or a cap."""

    num_steps: int
    num_simulated: int  # steps after the current one
    num_objects: int
    num_vertices: int
    num_edge_vertices: int
    num_stop_signs: int
    num_lights: int
    num_path_vertices: int
    num_paths: int

    @classmethod
    def of(cls, scenarios: Sequence[Packed], max_objects: int) -> "Sizes":
        """Returns sizes into which all the scenarios fit, but for capped objects.

        Args:
            scenarios: at least one.
            max_objects: objects of a scenario beyond this count are left out; those
                that matter most to the ego come first.
        """
        return cls(
            num_steps=max(s.num_steps for s in scenarios),
            num_simulated=max(s.num_steps - 1 - s.current_step for s in scenarios),
            num_objects=min(max(len(s.object_id) for s in scenarios), max_objects),
            num_vertices=max(len(s.vertices) for s in scenarios),
            num_edge_vertices=max(len(s.edge_normal) for s in scenarios),
            num_stop_signs=max(1, *(s.num_stop_signs for s in scenarios)),
            num_lights=max(1, *(len(s.light_xyz) for s in scenarios)),
            num_path_vertices=max(len(s.path_vertices) for s in scenarios),
            num_paths=max(len(s.path_on_route) for s in scenarios),
        )


class Bank(Record):
    """Packed scenarios, ragged: `first_x[i]` is where scenario i begins among the xs.

    Rows of padding follow the last scenario, so that a slice of static size fits.
    """

    sizes: Sizes = struct.field(pytree_node=False)
    dt: Float[Array, ""]  # seconds
    num_scenarios: Int[Array, ""]
    current_step: Int[Array, " scenarios"]
    num_steps: Int[Array, " scenarios"]
    centre: Float[Array, "scenarios 3"]
    quantum: Float[Array, " scenarios"]

    first_object: Int[Array, " scenarios"]
    num_objects: Int[Array, " scenarios"]
    object_type: Int[Array, " objects"]
    object_size: Float[Array, "objects 3"]
    goal_feasible: Bool[Array, " objects"]
    valid_bits: Int[Array, "objects words"]
    is_still: Bool[Array, " objects"]  # has one row, else one for each valid step
    first_row: Int[Array, " objects"]  # of the object in the two tables that follow
    poses: Array  # [rows, 3]
    turns: Array  # [rows, 3]

    first_vertex: Int[Array, " scenarios"]
    num_vertices: Int[Array, " scenarios"]
    vertices: Array  # [vertices, 3]
    vertex_tag: Int[Array, " vertices"]
    first_edge: Int[Array, " scenarios"]
    num_edge_vertices: Int[Array, " scenarios"]
    edge_normal: Array  # [edge vertices]
    first_stop_sign: Int[Array, " scenarios"]
    num_stop_signs: Int[Array, " scenarios"]
    stop_yaw: Array  # [stop signs]
    stop_has_lane: Bool[Array, " stop_signs"]
    index_corner: Float[Array, "scenarios 2"]
    index_shape: Int[Array, "scenarios 2"]
    first_node: Int[Array, " scenarios"]
    index_nodes: Int[Array, " nodes"]
    first_block: Int[Array, " scenarios"]
    index_blocks: Int[Array, " candidates"]
    tile_corner: Float[Array, "scenarios 2"]
    tile_shape: Int[Array, "scenarios 2"]
    first_tile: Int[Array, " scenarios"]
    tile_starts: Int[Array, " tiles"]
    tile_pieces: Int[Array, " vertices"]
    tile_reach: Float[Array, " scenarios"]

    first_light: Int[Array, " scenarios"]
    num_lights: Int[Array, " scenarios"]
    light_xyz: Array  # [lights, 3]
    light_state: Int[Array, "lights steps"]
    light_yaw: Array  # [lights]
    light_has_lane: Bool[Array, " lights"]

    first_path_vertex: Int[Array, " scenarios"]
    num_path_vertices: Int[Array, " scenarios"]
    path_vertices: Array  # [path vertices, 2]
    path_arc: Float[Array, " path_vertices"]
    path_limit: Int[Array, " path_vertices"]
    path_number: Int[Array, " path_vertices"]  # within the scenario
    first_path: Int[Array, " scenarios"]
    path_on_route: Bool[Array, " paths"]
    path_log_arc: Float[Array, "paths 2"]


def build(scenarios: Sequence[Packed], sizes: Sizes) -> Bank:
    """Puts scenarios into one bank of host arrays.

    Args:
        scenarios: at least one, all packed with the same `PackConfig`.
        sizes: into which they fit, but for capped objects.

    Raises:
        ValueError: if there is no scenario, steps differ in length, or some scenarios
            are quantised and others are not.
    """
    if not scenarios:
        raise ValueError("a bank needs at least one scenario, got none.")
    if len({s.dt for s in scenarios}) > 1:
        raise ValueError(
            f"scenarios have different steps: {sorted({s.dt for s in scenarios})} s."
        )
    if len({s.poses.dtype for s in scenarios}) > 1:
        raise ValueError("some scenarios are quantised and others are not.")
    kept = [_keep_objects(s, sizes) for s in scenarios]

    def table(name: str, padding: int = 0) -> np.ndarray:
        rows = [getattr(s, name) for s in kept]
        pad = np.zeros((padding, *rows[0].shape[1:]), rows[0].dtype)
        return np.concatenate([*rows, pad])

    def first(name: str) -> np.ndarray:
        return _starts([len(getattr(s, name)) for s in kept])

    def count(name: str) -> np.ndarray:
        return np.array([len(getattr(s, name)) for s in kept], np.int32)

    arrays: dict[str, Any] = dict(
        dt=np.array(kept[0].dt, np.float32),
        num_scenarios=np.array(len(kept), np.int32),
        current_step=np.array([s.current_step for s in kept], np.int32),
        num_steps=np.array([s.num_steps for s in kept], np.int32),
        centre=np.stack([s.centre for s in kept]),
        quantum=np.array([s.quantum for s in kept], np.float32),
        first_object=first("object_type"),
        num_objects=count("object_type"),
        object_type=table("object_type", sizes.num_objects),
        object_size=table("object_size", sizes.num_objects),
        goal_feasible=table("goal_feasible", sizes.num_objects),
        valid_bits=table("valid_bits", sizes.num_objects),
        is_still=table("is_still", sizes.num_objects),
        first_row=np.append(
            _starts(np.concatenate([_num_rows(s) for s in kept])),
            np.zeros(sizes.num_objects, np.int32),
        ),
        poses=table("poses", 1),
        turns=table("turns", 1),
        first_vertex=first("vertices"),
        num_vertices=count("vertices"),
        vertices=table("vertices", sizes.num_vertices),
        vertex_tag=table("vertex_tag", sizes.num_vertices),
        first_edge=first("edge_normal"),
        num_edge_vertices=count("edge_normal"),
        first_stop_sign=first("stop_yaw"),
        num_stop_signs=count("stop_yaw"),
        stop_yaw=table("stop_yaw", sizes.num_stop_signs),
        stop_has_lane=table("stop_has_lane", sizes.num_stop_signs),
        edge_normal=table("edge_normal", sizes.num_vertices),
        index_corner=np.stack([s.index_corner for s in kept]),
        index_shape=np.stack([s.index_shape for s in kept]),
        first_node=first("index_nodes"),
        index_nodes=table("index_nodes", 1),
        first_block=first("index_blocks"),
        index_blocks=table("index_blocks", 1),
        tile_corner=np.stack([s.tile_corner for s in kept]),
        tile_shape=np.stack([s.tile_shape for s in kept]),
        first_tile=first("tile_starts"),
        tile_starts=table("tile_starts", 1),
        tile_pieces=table("tile_pieces", sizes.num_vertices),
        tile_reach=np.array([s.tile_reach for s in kept], np.float32),
        first_light=first("light_xyz"),
        num_lights=count("light_xyz"),
        light_xyz=table("light_xyz", sizes.num_lights),
        light_state=table("light_state", sizes.num_lights),
        light_yaw=table("light_yaw", sizes.num_lights),
        light_has_lane=table("light_has_lane", sizes.num_lights),
        first_path_vertex=first("path_vertices"),
        num_path_vertices=count("path_vertices"),
        path_vertices=table("path_vertices", sizes.num_path_vertices),
        path_arc=table("path_arc", sizes.num_path_vertices),
        path_limit=table("path_limit", sizes.num_path_vertices),
        path_number=np.concatenate(
            [*map(_path_number, kept), np.zeros(sizes.num_path_vertices, np.int16)]
        ),
        first_path=first("path_on_route"),
        path_on_route=table("path_on_route", sizes.num_paths),
        path_log_arc=table("path_log_arc", sizes.num_paths),
    )
    return Bank(sizes=sizes, **arrays)


def build_shards(scenarios: Sequence[Packed], sizes: Sizes, num_shards: int) -> Bank:
    """Deals scenarios out to equal shards: every array gets a leading axis of shards.

    Shard i holds the scenarios i, i + num_shards, and so on.

    Raises:
        ValueError: if there are fewer scenarios than shards, or `build` does not like
            them.
    """
    if len(scenarios) < num_shards:
        raise ValueError(
            f"{len(scenarios)} scenarios cannot be shared by {num_shards} devices: "
            "use at least as many scenarios as devices."
        )
    shards = [build(scenarios[i::num_shards], sizes) for i in range(num_shards)]
    return jax.tree.map(lambda *arrays: _stack(arrays), *shards)


def _stack(arrays: Sequence[np.ndarray]) -> np.ndarray:
    longest = max(len(array) if array.ndim else 0 for array in arrays)
    padded = [
        np.pad(a, [(0, longest - len(a)), *[(0, 0)] * (a.ndim - 1)]) if a.ndim else a
        for a in arrays
    ]
    return np.stack(padded)


def _starts(counts: Sequence[int] | np.ndarray) -> np.ndarray:
    ends = np.cumsum(counts, dtype=np.int64)
    if len(ends) and ends[-1] > np.iinfo(np.int32).max:
        raise ValueError(
            f"{ends[-1]} rows do not fit into one device's bank: use more devices or "
            "fewer scenarios."
        )
    return np.concatenate([[0], ends[:-1]]).astype(np.int32)


def _num_rows(scenario: Packed) -> np.ndarray:
    return log_rows.num_rows(scenario.valid_bits, scenario.is_still)


def _path_number(scenario: Packed) -> np.ndarray:
    counts = np.diff(scenario.path_offset)
    return np.repeat(np.arange(len(counts), dtype=np.int16), counts)


def _keep_objects(scenario: Packed, sizes: Sizes) -> Packed:
    """Cuts off objects beyond the cap, and pads steps to the bank's number."""
    kept = slice(0, sizes.num_objects)
    num_rows = int(_num_rows(scenario)[kept].sum())
    words = -(-sizes.num_steps // 32) - scenario.valid_bits.shape[1]
    steps = sizes.num_steps - scenario.num_steps
    return dataclasses.replace(
        scenario,
        object_id=scenario.object_id[kept],
        object_type=scenario.object_type[kept],
        object_size=scenario.object_size[kept],
        goal_feasible=scenario.goal_feasible[kept],
        valid_bits=np.pad(scenario.valid_bits[kept], [(0, 0), (0, words)]),
        is_still=scenario.is_still[kept],
        poses=scenario.poses[:num_rows],
        turns=scenario.turns[:num_rows],
        light_state=np.pad(scenario.light_state, [(0, 0), (0, steps)]),
    )
