"""Holds many packed scenarios on a device, and shows them one at a time.

A world does not carry its map: it carries the number of its scenario in the bank. A
`Scene` is a view of one scenario whose accessors gather just what is asked for.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import jax
import numpy as np
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from ..records import Record
from . import log_rows
from .packed import Packed

MAX_ROWS = np.iinfo(np.int32).max  # of a table: their numbers have 32 bits
# The tables of the bank by what their rows are; `Packed.rows` counts these.
TABLES = {
    "objects": (
        "object_type",
        "object_size",
        "goal_feasible",
        "valid_bits",
        "is_still",
        "first_row",
    ),
    "rows": ("poses", "turns"),
    "vertices": ("vertices", "vertex_tag", "tile_pieces"),
    "edges": ("edge_normal",),
    "stop_signs": ("stop_yaw", "stop_has_lane"),
    "nodes": ("index_nodes",),
    "blocks": ("index_blocks",),
    "tiles": ("tile_starts",),
    "lights": ("light_xyz", "light_state", "light_yaw", "light_has_lane"),
    "path_vertices": ("path_vertices", "path_arc", "path_limit", "path_number"),
    "paths": ("path_on_route", "path_log_arc"),
}
# Where a scenario, or for rows an object, begins in the tables of a kind.
FIRST = {
    "objects": "first_object",
    "rows": "first_row",
    "vertices": "first_vertex",
    "edges": "first_edge",
    "stop_signs": "first_stop_sign",
    "nodes": "first_node",
    "blocks": "first_block",
    "tiles": "first_tile",
    "lights": "first_light",
    "path_vertices": "first_path_vertex",
    "paths": "first_path",
}


@runtime_checkable
class Counted(Protocol):
    """A scenario of which the counts are known: packed, or of a manifest."""

    @property
    def num_steps(self) -> int:
        """How many logged steps there are."""
        ...

    @property
    def current_step(self) -> int:
        """The last step of history."""
        ...

    @property
    def rows(self) -> dict[str, int]:
        """How many rows it has in the tables of each kind."""
        ...


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
    def of(cls, scenarios: Sequence[Counted], max_objects: int) -> "Sizes":
        """Returns sizes into which all the scenarios fit, but for capped objects.

        Args:
            scenarios: at least one.
            max_objects: objects of a scenario beyond this count are left out; those
                that matter most to the ego come first.
        """
        counts = [scenario.rows for scenario in scenarios]
        most = {kind: max(count[kind] for count in counts) for kind in TABLES}
        return cls(
            num_steps=max(s.num_steps for s in scenarios),
            num_simulated=max(s.num_steps - 1 - s.current_step for s in scenarios),
            num_objects=min(most["objects"], max_objects),
            num_vertices=most["vertices"],
            num_edge_vertices=most["edges"],
            num_stop_signs=max(1, most["stop_signs"]),
            num_lights=max(1, most["lights"]),
            num_path_vertices=most["path_vertices"],
            num_paths=most["paths"],
        )

    @property
    def padding(self) -> dict[str, int]:
        """Rows after the last scenario, so that a slice of static size fits."""
        return {
            "objects": self.num_objects,
            "rows": 1,
            "vertices": self.num_vertices,
            "edges": self.num_vertices,
            "stop_signs": self.num_stop_signs,
            "nodes": 1,
            "blocks": 1,
            "tiles": 1,
            "lights": self.num_lights,
            "path_vertices": self.num_path_vertices,
            "paths": self.num_paths,
        }


class Bank(Record):
    """Packed scenarios, ragged: `first_x[i]` is where scenario i begins among the xs.

    Rows of padding follow the last scenario, so that a slice of static size fits. A
    bank may consist of several pages, each of them such a run with its own padding.
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
    index_blocks: Int[Array, "rows candidates"]
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


def build(
    scenarios: Sequence[Packed],
    sizes: Sizes,
    capacity: Mapping[str, int] | None = None,
) -> Bank:
    """Puts scenarios into one bank of host arrays.

    Args:
        scenarios: at least one, all packed with the same `PackConfig`.
        sizes: into which they fit, but for capped objects.
        capacity: rows of the tables of each kind, padding included; by default as many
            as there are.

    Raises:
        ValueError: if there is no scenario, steps differ in length, some scenarios are
            quantised and others are not, or they do not fit into the capacity.
    """
    if not scenarios:
        raise ValueError("a bank needs at least one scenario, got none.")
    if len({s.dt for s in scenarios}) > 1:
        raise ValueError(
            f"scenarios have different steps: {sorted({s.dt for s in scenarios})} s."
        )
    if len({s.poses.dtype for s in scenarios}) > 1:
        raise ValueError("some scenarios are quantised and others are not.")
    kept = [_keep_objects(scenario, sizes) for scenario in scenarios]
    counts = {kind: np.array([s.rows[kind] for s in kept]) for kind in TABLES}
    arrays: dict[str, Any] = {
        FIRST[kind]: _starts(count) for kind, count in counts.items()
    }
    arrays |= _facts(kept, counts)
    row_counts = [log_rows.num_rows(s.valid_bits, s.is_still) for s in kept]
    extra = {
        "first_row": [_starts(np.concatenate(row_counts))],
        "path_number": [_path_number(s) for s in kept],
    }
    for kind, names in TABLES.items():
        total = int(counts[kind].sum())
        room = total + sizes.padding[kind] if capacity is None else capacity[kind]
        if room < total + sizes.padding[kind]:
            raise ValueError(
                f"{total} {kind} and their padding do not fit into {room} rows."
            )
        for name in names:
            rows = extra.get(name) or [getattr(s, name) for s in kept]
            rest = np.zeros((room - total, *rows[0].shape[1:]), rows[0].dtype)
            arrays[name] = np.concatenate([*rows, rest])
    return Bank(sizes=sizes, **arrays)


def _facts(kept: Sequence[Packed], counts: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Returns what the bank holds one of for each scenario, or at all."""

    def of_each(name: str, dtype: type) -> np.ndarray:
        return np.array([getattr(scenario, name) for scenario in kept], dtype)

    return dict(
        dt=np.array(kept[0].dt, np.float32),
        num_scenarios=np.array(len(kept), np.int32),
        current_step=of_each("current_step", np.int32),
        num_steps=of_each("num_steps", np.int32),
        centre=of_each("centre", np.float32),
        quantum=of_each("quantum", np.float32),
        num_objects=counts["objects"].astype(np.int32),
        num_vertices=counts["vertices"].astype(np.int32),
        num_edge_vertices=counts["edges"].astype(np.int32),
        num_stop_signs=counts["stop_signs"].astype(np.int32),
        num_lights=counts["lights"].astype(np.int32),
        num_path_vertices=counts["path_vertices"].astype(np.int32),
        index_corner=of_each("index_corner", np.float32),
        index_shape=of_each("index_shape", np.int32),
        tile_corner=of_each("tile_corner", np.float32),
        tile_shape=of_each("tile_shape", np.int32),
        tile_reach=of_each("tile_reach", np.float32),
    )


def num_bytes(scenario: Packed) -> int:
    """Returns how many bytes a bank grows by with the scenario."""
    sizes = Sizes.of([scenario], len(scenario.object_id))
    one, two = (build([scenario] * count, sizes) for count in (1, 2))
    return total_bytes(two) - total_bytes(one)


def total_bytes(bank: Bank) -> int:
    """Returns how many bytes a bank takes, on all devices together."""
    return sum(leaf.nbytes for leaf in jax.tree.leaves(bank))


def _starts(counts: Sequence[int] | np.ndarray) -> np.ndarray:
    ends = np.cumsum(counts, dtype=np.int64)
    if len(ends) and ends[-1] > MAX_ROWS:
        raise ValueError(
            f"{ends[-1]} rows do not fit into one device's bank: use more devices or "
            "fewer scenarios."
        )
    return np.concatenate([[0], ends[:-1]]).astype(np.int32)


def _path_number(scenario: Packed) -> np.ndarray:
    counts = np.diff(scenario.path_offset)
    return np.repeat(np.arange(len(counts), dtype=np.int16), counts)


def _keep_objects(scenario: Packed, sizes: Sizes) -> Packed:
    """Cuts off objects beyond the cap, and pads steps to the bank's number."""
    kept = slice(0, sizes.num_objects)
    row_counts = log_rows.num_rows(scenario.valid_bits, scenario.is_still)
    num_rows = int(row_counts[kept].sum())
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
