"""Reads the map archives of Argoverse 2, one JSON file beside each scenario."""

import dataclasses
import pathlib
import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float

from ..scenario import LaneLinks, MapType, Polylines, ScenarioError
from . import base, json_values, lane_map
from .lane_map import Lane

_PARTS = ("lane_segments", "drivable_areas", "pedestrian_crossings")
_HEAD = re.compile(rb'[\xef\xbb\xbf\s]*\{\s*"(?:' + "|".join(_PARTS).encode() + rb')"')

_LANE_TYPES = {
    "VEHICLE": MapType.LANE_SURFACE_STREET,
    "BUS": MapType.LANE_SURFACE_STREET,
    "BIKE": MapType.LANE_BIKE,
}

# Of two lines of which one may be crossed, WOMD knows the yellow ones alone.
_LINE_TYPES = {
    "DASHED_WHITE": MapType.LINE_BROKEN_SINGLE_WHITE,
    "DOUBLE_DASH_WHITE": MapType.LINE_BROKEN_SINGLE_WHITE,
    "SOLID_WHITE": MapType.LINE_SOLID_SINGLE_WHITE,
    "DOUBLE_SOLID_WHITE": MapType.LINE_SOLID_DOUBLE_WHITE,
    "DASHED_YELLOW": MapType.LINE_BROKEN_SINGLE_YELLOW,
    "DOUBLE_DASH_YELLOW": MapType.LINE_BROKEN_DOUBLE_YELLOW,
    "SOLID_YELLOW": MapType.LINE_SOLID_SINGLE_YELLOW,
    "DOUBLE_SOLID_YELLOW": MapType.LINE_SOLID_DOUBLE_YELLOW,
    "DASH_SOLID_YELLOW": MapType.LINE_PASSING_DOUBLE_YELLOW,
    "SOLID_DASH_YELLOW": MapType.LINE_PASSING_DOUBLE_YELLOW,
    "NONE": None,
}


def is_map(head: bytes) -> bool:
    """Tells a map archive from its first bytes."""
    return _HEAD.match(head) is not None


def read(folder: pathlib.Path, scenario_id: str) -> tuple[Polylines, LaneLinks]:
    """Reads the map of a scenario from the folder in which the scenario lies.

    Raises:
        ScenarioError: if there is no map of this id, or it is malformed.
    """
    name = f"log_map_archive_{scenario_id}.json"
    for path in (folder / name, folder / f"{name}.gz"):
        if path.is_file():
            with base.opened(path) as stream:
                text = base.take(stream, base.MAX_RECORD_BYTES + 1)
            return convert(text)
    raise ScenarioError(
        f"its map {name} is not beside the parquet file; copy it there too"
    )


def convert(text: bytes) -> tuple[Polylines, LaneLinks]:
    """Makes the map and the links of its lanes of an archive's text.

    Raises:
        ScenarioError: if the text is no map archive, or malformed.
    """
    if len(text) > base.MAX_RECORD_BYTES:
        raise ScenarioError(f"its map is longer than {base.MAX_RECORD_BYTES} bytes")
    document = json_values.document(text, "its map")
    segments, areas, crossings = (_members(document, name) for name in _PARTS)
    lanes = []
    for name, segment in segments:
        with base.naming(f"map: lane segment {name}"):
            lanes.append(_lane(segment))
    rings = []
    for name, area in areas:
        with base.naming(f"map: drivable area {name}"):
            rings.append(json_values.places(area["area_boundary"]))
    crosswalks = []
    for name, crossing in crossings:
        with base.naming(f"map: pedestrian crossing {name}"):
            (crossing_id,) = json_values.integers([crossing["id"]]).tolist()
            crosswalks.append((MapType.CROSSWALK, crossing_id, _polygon(crossing)))
    lanes = _leading_the_same_way(lanes)
    return lane_map.roads(lanes, rings, crosswalks), lane_map.links(lanes)


def _members(document: Any, name: str) -> Iterable[tuple[str, Any]]:
    """Returns the members of a part of the document by name."""
    if not isinstance(document, dict) or not isinstance(document.get(name), dict):
        raise ScenarioError(f"its map has no mapping '{name}'")
    return document[name].items()


def _lane(segment: Any) -> Lane:
    beside = [segment["left_neighbor_id"], segment["right_neighbor_id"]]
    (lane_id,) = json_values.integers([segment["id"]]).tolist()
    return Lane(
        lane_id=lane_id,
        kind=_LANE_TYPES.get(segment["lane_type"], MapType.LANE_UNDEFINED),
        left=json_values.places(segment["left_lane_boundary"]),
        right=json_values.places(segment["right_lane_boundary"]),
        left_line=_line(segment["left_lane_mark_type"]),
        right_line=_line(segment["right_lane_mark_type"]),
        successors=_ids(segment["successors"]),
        predecessors=_ids(segment["predecessors"]),
        neighbors=_ids(name for name in beside if name is not None),
    )


def _line(word: str) -> MapType | None:
    return _LINE_TYPES.get(word, MapType.LINE_UNKNOWN)


def _ids(values: Iterable[Any]) -> tuple[int, ...]:
    return tuple(json_values.integers(values).tolist())


def _leading_the_same_way(lanes: list[Lane]) -> list[Lane]:
    """Drops neighbours that lead the other way: the archive lists both kinds."""
    chord = {lane.lane_id: lane.left[-1] + lane.right[-1] for lane in lanes}
    for lane in lanes:
        chord[lane.lane_id] = chord[lane.lane_id] - lane.left[0] - lane.right[0]
    return [
        dataclasses.replace(
            lane,
            neighbors=tuple(
                name
                for name in lane.neighbors
                if name in chord and chord[name][:2] @ chord[lane.lane_id][:2] > 0
            ),
        )
        for lane in lanes
    ]


def _polygon(crossing: Any) -> Float[np.ndarray, "points 3"]:
    """Returns the ring that the two edges of a crossing make, whichever way they go."""
    one, other = (json_values.places(crossing[name]) for name in ("edge1", "edge2"))
    if not len(one) or not len(other):
        raise ScenarioError("an edge has no points")
    straight = np.linalg.norm(one[-1] - other[-1]) + np.linalg.norm(one[0] - other[0])
    crossed = np.linalg.norm(one[-1] - other[0]) + np.linalg.norm(one[0] - other[-1])
    return np.concatenate([one, other[::-1] if straight <= crossed else other])
