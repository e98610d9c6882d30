"""Reads the binary maps of PufferDrive, WOMD with simplified roads, one a file.

Little-endian, of 4 bytes each: the number of objects and of roads; for an object its
type, id and number of steps, rows of its states and seven single values; for a road its
type, id and number of points, rows of their places, and the same seven values.
"""

import dataclasses
import functools
import pathlib
import struct
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from .. import scenario
from ..scenario import (
    MapType,
    ObjectType,
    Polylines,
    Scenario,
    ScenarioError,
    Tracks,
)
from . import base, parts
from .base import BadRecord, Reader

_NAME = "pufferdrive"
_COUNTS = struct.Struct("<ii")
_TITLE = struct.Struct("<iii")  # type, id, number of steps or points
_TAIL_VALUES = 7  # width, length, height, goal and whether an expert drives
_STATE_ROWS = 8  # x, y, z, their velocities, heading, and whether valid (an integer)
_PLACE_ROWS = 3
_VALUE_BYTES = 4

# What a head may say to be taken for one of this format.
_MOST = {"objects": 10_000, "roads": 100_000, "steps": 10_000}
_OBJECT_KINDS = range(max(ObjectType) + 1)

# As in the files of GPUDrive, from which these are made, only the kind is told.
_MAP_TYPES = {
    4: MapType.LANE_UNDEFINED,
    5: MapType.LINE_UNKNOWN,
    6: MapType.EDGE_BOUNDARY,
    7: MapType.STOP_SIGN,
    8: MapType.CROSSWALK,
    9: MapType.SPEED_BUMP,
    10: MapType.DRIVEWAY,
}
ASSUMPTIONS = (
    f"steps of {scenario.DT} s",
    "kinds of lanes, lines and edges",
    "no lights in the file",
    "ego: chosen among the vehicles",
    parts.NO_LANE_GRAPH,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Block:
    """An object or a road as it stands in the file."""

    kind: int
    number: int
    rows: Float[np.ndarray, "rows length"]  # float32; validity is to be viewed as int32
    tail: Float[np.ndarray, " values"]
    end: int  # where the next one begins


def convert(record: bytes, fallback_id: str) -> Scenario:
    """Makes a scenario of a map.

    Args:
        record: the file.
        fallback_id: names the scenario: the file does not.

    Returns:
        The scenario, without lights and lane graph; `scenario.check` has yet to look
        at it.

    Raises:
        ScenarioError: if a count does not agree with the length of the file, or the
            objects differ in their numbers of steps.
    """
    if len(record) < _COUNTS.size:
        raise ScenarioError(f"the file ends after {len(record)} bytes; copy it again")
    num_objects, num_roads = _COUNTS.unpack_from(record)
    objects = _blocks(record, _COUNTS.size, num_objects, _STATE_ROWS, "object")
    roads = _blocks(record, objects[-1].end, num_roads, _PLACE_ROWS, "road")
    at = roads[-1].end
    if at != len(record):
        raise ScenarioError(
            f"{len(record) - at} bytes follow the last road; the counts of the file "
            "are damaged, or it holds something else: copy it again"
        )
    tracks = _tracks(objects)
    ego_index, ego_source = scenario.choose_ego(tracks, marked=None)
    return Scenario(
        scenario_id=fallback_id,
        dataset=_NAME,
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=_roads(roads),
        lights=parts.no_lights(tracks.valid.shape[1]),
        lane_links=None,
        assumptions=ASSUMPTIONS,
    )


def _blocks(
    record: bytes, start: int, count: int, num_rows: int, what: str
) -> list[_Block]:
    """Returns the objects or roads that begin at a byte, as far as the bytes reach."""
    if count < 1:
        raise ScenarioError(f"the file claims {count} {what}s; at least 1 is needed")
    blocks, at = [], start
    for index in range(count):
        rest = len(record) - at - _TITLE.size - _VALUE_BYTES * _TAIL_VALUES
        kind, number, length = _TITLE.unpack_from(record, at) if rest >= 0 else (0,) * 3
        num_values = num_rows * length
        if rest < 0 or not 0 <= _VALUE_BYTES * num_values <= rest:
            raise ScenarioError(
                f"{what} {index} of {count}, of the length {length}, does not fit into "
                f"the {len(record)} bytes of the file, which is damaged or cut off: "
                "copy it again"
            )
        values = np.frombuffer(
            record, "<f4", num_values + _TAIL_VALUES, at + _TITLE.size
        )
        at += _TITLE.size + values.nbytes
        blocks.append(
            _Block(
                kind=kind,
                number=number,
                rows=values[:num_values].reshape(num_rows, length),
                tail=values[num_values:],
                end=at,
            )
        )
    return blocks


def _tracks(objects: list[_Block]) -> Tracks:
    num_steps = {block.rows.shape[1] for block in objects}
    if len(num_steps) > 1:
        raise ScenarioError(
            f"the objects have {min(num_steps)} to {max(num_steps)} steps; all must "
            "have the same number"
        )
    num_states = len(objects) * num_steps.pop()
    parts.require_few(num_states, parts.MAX_STATES, "states of objects")
    rows = np.stack([block.rows for block in objects])
    valid = rows[:, -1].copy().view("<i4") == 1
    x, y, z, vx, vy, _, heading = rows[:, :-1].transpose(1, 0, 2)
    tail = np.stack([block.tail for block in objects])
    yaw = parts.zero_unless(valid, heading[..., None])[..., 0]
    return Tracks(
        object_id=np.array([block.number for block in objects], np.int64),
        object_type=parts.object_types(
            np.array([block.kind for block in objects], np.int64)
        ),
        xyz=parts.zero_unless(valid, np.stack([x, y, z], axis=-1)),
        yaw=parts.wrap_angle(yaw),
        velocity=parts.zero_unless(valid, np.stack([vx, vy], axis=-1)),
        valid=valid,
        size=tail[:, [1, 0, 2]].astype(np.float64),
        is_of_interest=np.zeros(len(objects), bool),
    )


def _roads(roads: list[_Block]) -> Polylines:
    for index, block in enumerate(roads):
        if block.kind not in _MAP_TYPES:
            raise ScenarioError(
                f"road {index} is of type {block.kind}; known are "
                f"{', '.join(map(str, _MAP_TYPES))}"
            )
    return parts.polylines(
        np.concatenate([block.rows.T for block in roads]).astype(np.float64),
        np.array([block.rows.shape[1] for block in roads], np.int64),
        np.array([_MAP_TYPES[block.kind] for block in roads], np.int64),
        np.array([block.number for block in roads], np.int64),
    )


def _recognizes(head: bytes) -> bool:
    """Tells by the counts and the first object: the format has no mark of its own."""
    if len(head) < _COUNTS.size + _TITLE.size:
        return False
    num_objects, num_roads = _COUNTS.unpack_from(head)
    kind, _, num_steps = _TITLE.unpack_from(head, _COUNTS.size)
    return (
        0 < num_objects <= _MOST["objects"]
        and 0 < num_roads <= _MOST["roads"]
        and 0 < num_steps <= _MOST["steps"]
        and kind in _OBJECT_KINDS
    )


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    scene = functools.partial(
        convert, fallback_id=path.name.removesuffix(".gz").removesuffix(".bin")
    )
    yield from base.only_record(path, scene)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
