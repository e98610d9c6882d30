"""Reads Scenario protos, the form of WOMD with the lane graph, from TFRecords."""

import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float

from .. import scenario
from ..scenario import (
    LaneLinks,
    Lights,
    MapType,
    Polylines,
    Scenario,
    ScenarioError,
    Tracks,
)
from . import parts, tfrecord, wire
from .base import BadRecord, Reader

_NAME = "womd_scenario"

# Where the types of a kind of feature begin in `MapType`; the field with its points.
_FEATURES = {
    "lane": (MapType.LANE_UNDEFINED, "polyline"),
    "road_line": (MapType.LINE_UNKNOWN, "polyline"),
    "road_edge": (MapType.EDGE_UNKNOWN, "polyline"),
    "stop_sign": (MapType.STOP_SIGN, "position"),
    "crosswalk": (MapType.CROSSWALK, "polygon"),
    "speed_bump": (MapType.SPEED_BUMP, "polygon"),
    "driveway": (MapType.DRIVEWAY, "polygon"),
}
_MOST_MESSAGES = 100_000  # of one kind: a hundred times what was seen
_NUM_TYPES = {"lane": 4, "road_line": 9, "road_edge": 3}


def convert(record: bytes) -> Scenario:
    """Makes a scenario of a Scenario proto.

    Args:
        record: the proto as it stands in the file.

    Returns:
        The scenario; `scenario.check` has yet to look at it.

    Raises:
        ScenarioError: if the bytes are no Scenario proto, or its parts contradict one
            another.
    """
    proto = wire.parse("Scenario", record)
    if not proto.scenario_id or not proto.tracks:
        raise ScenarioError("no scenario_id or no tracks: this is no Scenario of WOMD")
    for field in ("tracks", "map_features", "dynamic_map_states"):
        parts.require_few(len(getattr(proto, field)), _MOST_MESSAGES, field)
    if not proto.current_time_index >= 0:
        raise ScenarioError(
            f"current_time_index must be at least 0, got {proto.current_time_index}"
        )
    tracks = _tracks(proto)
    ego_index, ego_source = scenario.choose_ego(
        tracks, proto.sdc_track_index if proto.HasField("sdc_track_index") else None
    )
    return Scenario(
        scenario_id=proto.scenario_id.decode(errors="replace"),
        dataset=_NAME,
        dt=parts.step_length(proto.timestamps_seconds),
        current_step=proto.current_time_index,
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=_roads(proto),
        lights=_lights(proto, num_steps=tracks.valid.shape[1]),
        lane_links=_lane_links(proto),
    )


def _points(messages: list[bytes]) -> Float[np.ndarray, "points 3"]:
    """Decodes MapPoints."""
    point = wire.columns("MapPoint", messages)
    return np.stack([point["x"], point["y"], point["z"]], axis=-1)


def _tracks(proto: Any) -> Tracks:
    num_steps = [len(track.states) for track in proto.tracks]
    parts.require_few(sum(num_steps), parts.MAX_STATES, "states of objects")
    if min(num_steps) != max(num_steps):
        raise ScenarioError(
            f"the tracks have {min(num_steps)} to {max(num_steps)} steps; all must have"
            " the same number"
        )
    state = {
        name: column.reshape(len(num_steps), -1)
        for name, column in wire.columns(
            "ObjectState", [state for track in proto.tracks for state in track.states]
        ).items()
    }

    def stacked(*names: str) -> Float[np.ndarray, "objects steps features"]:
        return parts.zero_unless(valid, np.stack([state[n] for n in names], axis=-1))

    valid = state["valid"].astype(bool)
    object_id = np.array([track.id for track in proto.tracks], np.int64)
    size = stacked("length", "width", "height")
    return Tracks(
        object_id=object_id,
        object_type=parts.object_types(
            np.array([track.object_type for track in proto.tracks], np.int64)
        ),
        xyz=stacked("center_x", "center_y", "center_z"),
        yaw=parts.wrap_angle(stacked("heading")[..., 0]),
        velocity=stacked("velocity_x", "velocity_y"),
        valid=valid,
        size=parts.constant_size(size, valid, proto.current_time_index),
        is_of_interest=parts.of_interest(
            object_id,
            list(proto.objects_of_interest),
            [prediction.track_index for prediction in proto.tracks_to_predict],
        ),
    )


def _roads(proto: Any) -> Polylines:
    points, num_points, map_type, feature_id = [], [], [], []
    for feature in proto.map_features:
        # A feature of none of these kinds is newer than the schema: it has no MapType.
        for kind, (first_type, field) in _FEATURES.items():
            if feature.HasField(kind):
                content = getattr(feature, kind)
                run = getattr(content, field)
                total = len(points) + len(run)
                parts.require_few(total, parts.MAX_POINTS, "points of the map")
                points.extend(run)
                num_points.append(len(run))
                map_type.append(first_type + _type_of(content, kind))
                feature_id.append(feature.id)
    return parts.polylines(
        _points(points),
        np.array(num_points, np.int64),
        np.array(map_type, np.int64),
        np.array(feature_id, np.int64),
    )


def _type_of(content: Any, kind: str) -> int:
    """Returns the type of a feature among those of its kind; 0 also means unknown."""
    if kind not in _NUM_TYPES:
        return 0
    return content.type if 0 <= content.type < _NUM_TYPES[kind] else 0


def _lights(proto: Any, num_steps: int) -> Lights:
    rows = [
        (light.lane, step, light.state, light.HasField("stop_point"))
        for step, state in enumerate(proto.dynamic_map_states)
        for light in state.lane_states
    ]
    lane_id, step, state, has_place = np.array(rows, np.int64).reshape(-1, 4).T
    return parts.lights(
        lane_id=lane_id,
        step=step,
        state=state,
        xyz=_points(
            [
                light.stop_point
                for state in proto.dynamic_map_states
                for light in state.lane_states
            ]
        ),
        valid=has_place.astype(bool),
        num_steps=num_steps,
    )


def _lane_links(proto: Any) -> LaneLinks:
    successor, neighbor, stop, limits = [], [], [], {}
    for feature in proto.map_features:
        if feature.HasField("stop_sign"):
            stop += [(feature.id, lane) for lane in feature.stop_sign.lane]
        if feature.HasField("lane"):
            lane = feature.lane
            successor += [(feature.id, exit_id) for exit_id in lane.exit_lanes]
            successor += [(entry_id, feature.id) for entry_id in lane.entry_lanes]
            for beside in (*lane.left_neighbors, *lane.right_neighbors):
                neighbor.append((feature.id, beside.feature_id))
            if lane.HasField("speed_limit_mph"):
                limits[feature.id] = lane.speed_limit_mph * parts.MPH
    return parts.lane_links(successor, neighbor, stop, limits)


def _recognizes(head: bytes) -> bool:
    payload = tfrecord.first_payload(head)
    return payload is not None and not wire.looks_like_example(payload)


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    return tfrecord.scenarios(path, convert)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
