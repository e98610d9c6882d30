"""Reads the JSON form of WOMD that Nocturne and GPUDrive use, one scenario a file."""

import functools
import operator
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from .. import scenario
from ..scenario import (
    Lights,
    LightState,
    MapType,
    ObjectType,
    Polylines,
    Scenario,
    ScenarioError,
    Tracks,
)
from . import base, json_values, parts
from .base import BadRecord, Reader

_NAME = "womd_json"
_CURRENT_STEP = 10
_MAX_RADIANS = 6.3  # a file with a larger heading is in degrees

_OBJECT_TYPES = {member.name.lower(): member for member in ObjectType}
_LIGHT_STATES = {member.name.lower(): member for member in LightState}

# Old files say no more than the kind. Most edges bound the road: few are medians.
_MAP_TYPES = {
    "lane": MapType.LANE_UNDEFINED,
    "road_line": MapType.LINE_UNKNOWN,
    "road_edge": MapType.EDGE_BOUNDARY,
    "stop_sign": MapType.STOP_SIGN,
    "crosswalk": MapType.CROSSWALK,
    "speed_bump": MapType.SPEED_BUMP,
    "driveway": MapType.DRIVEWAY,
}
_KNOWN_CODES = frozenset(MapType)

# Metres, for files without heights: near what WOMD measures, in which nothing is exact.
_DEFAULT_HEIGHTS = {
    ObjectType.UNSET: 1.5,
    ObjectType.VEHICLE: 1.7,
    ObjectType.PEDESTRIAN: 1.75,
    ObjectType.CYCLIST: 1.8,
    ObjectType.OTHER: 1.5,
}


def convert(record: bytes, fallback_id: str) -> Scenario:
    """Makes a scenario of a JSON document.

    Args:
        record: the text.
        fallback_id: names the scenario where the text does not.

    Returns:
        The scenario, without a lane graph; `scenario.check` has yet to look at it.

    Raises:
        ScenarioError: if the text is no JSON, or not that of a log of WOMD.
    """
    document = _document(record)
    metadata = _mapping(document, "metadata")
    with base.naming("metadata"):
        mark = metadata.get("sdc_track_index")
        marked = None if mark is None else operator.index(mark)
    tracks, in_degrees = _tracks(document["objects"], metadata)
    ego_index, ego_source = scenario.choose_ego(tracks, marked)
    scenario_id: Any = document.get("scenario_id") or fallback_id
    if not isinstance(scenario_id, str):
        raise ScenarioError(f"'scenario_id' must be a text, got {scenario_id!r:.40}")
    return Scenario(
        scenario_id=scenario_id,
        dataset=_NAME,
        current_step=_CURRENT_STEP,
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=_roads(document["roads"]),
        lights=_lights(_mapping(document, "tl_states"), tracks.valid.shape[1]),
        lane_links=None,
        assumptions=_assumptions(document, in_degrees, ego_source),
    )


def _assumptions(
    document: dict[str, Any], in_degrees: bool, ego_source: str
) -> tuple[str, ...]:
    """Returns what the document, of which the parts were read, does not say."""
    objects, roads = document["objects"], document["roads"]
    runs = [item["position"] for item in objects] + [road["geometry"] for road in roads]
    made_up = {
        "ego: chosen among the vehicles": ego_source != "marked",
        "headings: degrees, as some exceed 6.3": in_degrees,
        "headings: radians, as none exceeds 6.3": not in_degrees,
        "heights: one for each kind of object": _lack(objects, "height"),
        "places: at height zero": _lack([run[0] for run in runs if run], "z"),
        "ids: the places in the lists": _lack([*objects, *roads], "id"),
        "kinds of lanes, lines and edges": any(
            road.get("map_element_id") not in _KNOWN_CODES for road in roads
        ),
        parts.NO_LANE_GRAPH: True,
    }
    return tuple(word for word, is_so in made_up.items() if is_so)


def _lack(records: list[Any], name: str) -> bool:
    return any(name not in record for record in records)


def _document(record: bytes) -> dict[str, Any]:
    """Parses the text and finds the two lists that there must be."""
    document = json_values.document(record, "the text")
    if isinstance(document, dict) and "lane_segments" in document:
        raise ScenarioError(
            "this is the map of an Argoverse 2 log; name the .parquet file beside it, "
            "which finds its map itself"
        )
    for name in ("objects", "roads"):
        if not isinstance(document, dict) or not isinstance(document.get(name), list):
            raise ScenarioError(f"there is no list '{name}': this is no JSON of WOMD")
        if not document[name]:
            raise ScenarioError(f"the list '{name}' is empty")
    return document


def _mapping(document: dict[str, Any], name: str) -> dict[str, Any]:
    """Returns a part of the document that may be absent, then as an empty mapping."""
    part = document.get(name)
    if part is not None and not isinstance(part, dict):
        raise ScenarioError(f"'{name}' must be a mapping, got {part!r:.40}")
    return part or {}


def _tracks(objects: list[Any], metadata: dict[str, Any]) -> tuple[Tracks, bool]:
    """Reads the objects, all of which must have the same number of steps.

    Returns:
        The tracks, and whether their headings were taken for degrees: old files are in
        degrees, and none says which.
    """
    rows = []
    for index, item in enumerate(objects):
        with base.naming(f"objects[{index}]"):
            row = _object_row(item, index)
            num_steps = [len(column) for column in row[-4:]]
            if rows:
                num_steps.append(len(rows[0][-1]))
            if min(num_steps) != max(num_steps):
                raise ScenarioError(f"lists have {num_steps} steps, which should agree")
            rows.append(row)

    columns = [np.array(column) for column in zip(*rows, strict=True)]
    object_id, object_type, size, xyz, velocity, heading, valid = columns
    with base.naming("metadata"):
        is_of_interest = parts.of_interest(
            object_id,
            json_values.integers(metadata.get("objects_of_interest", [])).tolist(),
            json_values.integers(
                [
                    track["track_index"]
                    for track in metadata.get("tracks_to_predict", [])
                ]
            ).tolist(),
        )
    in_degrees = bool((np.abs(heading[valid]) > _MAX_RADIANS).any())
    yaw = parts.wrap_angle(np.radians(heading) if in_degrees else heading)
    tracks = Tracks(
        object_id=object_id,
        object_type=object_type,
        xyz=parts.zero_unless(valid, xyz),
        yaw=parts.zero_unless(valid, yaw[..., None])[..., 0],
        velocity=parts.zero_unless(valid, velocity),
        valid=valid,
        size=size,
        is_of_interest=is_of_interest,
    )
    return tracks, in_degrees


def _object_row(item: Any, index: int) -> tuple[Any, ...]:
    """Returns id, type, size, position, velocity, heading and validity of an object."""
    object_type = _OBJECT_TYPES.get(item["type"], ObjectType.OTHER)
    height = item["height"] if "height" in item else _DEFAULT_HEIGHTS[object_type]
    (object_id,) = json_values.integers([item["id"] if "id" in item else index])
    return (
        object_id,
        int(object_type),
        json_values.floats([item["length"], item["width"], height]),
        json_values.places(item["position"]),
        json_values.vectors(item["velocity"], ("x", "y"))[:, :2],
        json_values.floats(item["heading"]),
        json_values.floats(item["valid"]) != 0,
    )


def _roads(roads: list[Any]) -> Polylines:
    features = []
    for index, road in enumerate(roads):
        with base.naming(f"roads[{index}]"):
            if road["type"] not in _MAP_TYPES:
                raise ScenarioError(
                    f"'type' is {road['type']!r:.40}; known are {', '.join(_MAP_TYPES)}"
                )
            code = road.get("map_element_id")
            known = code if code in _KNOWN_CODES else _MAP_TYPES[road["type"]]
            (feature_id,) = json_values.integers(
                [road["id"] if "id" in road else index]
            )
            features.append(
                (json_values.places(road["geometry"]), int(known), feature_id)
            )
    points, map_type, feature_id = zip(*features, strict=True)
    return parts.polylines(
        np.concatenate(points),
        np.array([len(run) for run in points]),
        np.array(map_type),
        np.array(feature_id),
    )


def _lights(lanes: dict[str, Any], num_steps: int) -> Lights:
    columns = [(np.zeros(0, np.int64),) * 3 + (np.zeros((0, 3)),)]
    with base.naming("tl_states"):
        for lane, light in lanes.items():
            step = json_values.integers(light["time_index"])
            state = [
                _LIGHT_STATES.get(word, LightState.UNKNOWN) for word in light["state"]
            ]
            height = light["z"] if "z" in light else [0.0] * len(step)
            xyz = [
                json_values.floats(light["x"]),
                json_values.floats(light["y"]),
                json_values.floats(height),
            ]
            lane_id = np.repeat(json_values.integers([int(lane)]), len(step))
            if any(len(column) != len(step) for column in (state, *xyz)):
                raise ScenarioError(f"the lists of lane {lane} differ in length")
            columns.append(
                (lane_id, step, json_values.integers(state), np.stack(xyz, axis=-1))
            )
    lane_id, step, state, xyz = map(np.concatenate, zip(*columns, strict=True))
    return parts.lights(
        lane_id=lane_id,
        step=step,
        state=state,
        xyz=xyz,
        valid=np.ones(len(step), bool),
        num_steps=num_steps,
    )


def _recognizes(head: bytes) -> bool:
    return head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    fallback_id = path.name.removesuffix(".gz").removesuffix(".json")
    scene = functools.partial(convert, fallback_id=fallback_id)
    return base.only_record(path, scene)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
