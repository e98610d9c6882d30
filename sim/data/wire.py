"""Parses the protocol buffers of WOMD, with descriptors built when this file is loaded.

The schemas are `scenario.proto` and `map.proto` of the Waymo Open Dataset and
`example.proto` of TensorFlow, less the fields that nobody reads. Messages that come by
the ten thousand are declared as bytes and decoded by `columns`.
"""

import functools
import itertools
import re
from typing import Any

import numpy as np
from google.protobuf import (
    descriptor_pb2,
    descriptor_pool,
    message_factory,
    unknown_fields,
)
from google.protobuf.message import DecodeError, Message
from jaxtyping import Shaped

from ..scenario import ScenarioError

_SCHEMA = """
message Scenario
  repeated double timestamps_seconds = 1
  optional bytes scenario_id = 5
  optional int32 current_time_index = 10
  repeated Track tracks = 2
  repeated DynamicMapState dynamic_map_states = 7
  repeated MapFeature map_features = 8
  optional int32 sdc_track_index = 6
  repeated int32 objects_of_interest = 4
  repeated RequiredPrediction tracks_to_predict = 11
message Track
  optional int32 id = 1
  optional int32 object_type = 2
  repeated bytes states = 3
message ObjectState
  optional double center_x = 2
  optional double center_y = 3
  optional double center_z = 4
  optional float length = 5
  optional float width = 6
  optional float height = 7
  optional float heading = 8
  optional float velocity_x = 9
  optional float velocity_y = 10
  optional bool valid = 11
message RequiredPrediction
  optional int32 track_index = 1
message DynamicMapState
  repeated TrafficSignalLaneState lane_states = 1
message TrafficSignalLaneState
  optional int64 lane = 1
  optional int32 state = 2
  optional bytes stop_point = 3
message MapPoint
  optional double x = 1
  optional double y = 2
  optional double z = 3
message MapFeature
  optional int64 id = 1
  optional LaneCenter lane = 3
  optional RoadLine road_line = 4
  optional RoadLine road_edge = 5
  optional StopSign stop_sign = 7
  optional Polygon crosswalk = 8
  optional Polygon speed_bump = 9
  optional Polygon driveway = 10
message LaneCenter
  optional double speed_limit_mph = 1
  optional int32 type = 2
  repeated bytes polyline = 8
  repeated int64 entry_lanes = 9
  repeated int64 exit_lanes = 10
  repeated LaneNeighbor left_neighbors = 11
  repeated LaneNeighbor right_neighbors = 12
message LaneNeighbor
  optional int64 feature_id = 1
message RoadLine
  optional int32 type = 1
  repeated bytes polyline = 2
message StopSign
  repeated int64 lane = 1
  repeated bytes position = 2
message Polygon
  repeated bytes polygon = 1
message Example
  optional Features features = 1
message Features
  repeated Entry feature = 1
message Entry
  optional bytes key = 1
  optional bytes value = 2
message Feature
  optional BytesList bytes_list = 1
  optional FloatList float_list = 2
  optional Int64List int64_list = 3
message PackedFeature
  optional BytesList float_list = 2
message BytesList
  repeated bytes value = 1
message FloatList
  repeated float value = 1
message Int64List
  repeated int64 value = 1
"""

_DTYPES = {"double": "<f8", "float": "<f4", "bool": "u1"}
_WIRE_TYPES = {"double": 1, "float": 5, "bool": 0}

# The outer field of an Example holds map entries, and these begin with a key in text.
_EXAMPLE_HEAD = re.compile(rb"(\x0a[\x80-\xff]*[\x00-\x7f]){3}[!-~]", re.DOTALL)
_EXAMPLE_KEY = re.compile(rb"(state|scenario|roadgraph_samples|traffic_light_state)/")


def _fields(message: str) -> list[tuple[str, str, str, int]]:
    """Returns label, type, name and number of each field of a message of the schema."""
    (block,) = re.findall(rf"^message {message}\n((?:  .*\n)*)", _SCHEMA, re.MULTILINE)
    found = re.findall(r"  (\w+) (\w+) (\w+) = (\d+)\n", block)
    return [(label, kind, name, int(number)) for label, kind, name, number in found]


@functools.cache
def _pool() -> Any:  # the C implementation has a class of its own
    """Builds the descriptors of the schema, in a pool of its own."""
    proto = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(
        name="womd.proto", package="drivetrain", syntax="proto2"
    )
    for message in re.findall(r"^message (\w+)$", _SCHEMA, re.MULTILINE):
        descriptor = file.message_type.add(name=message)
        for label, kind, name, number in _fields(message):
            field = descriptor.field.add(name=name, number=number)
            field.label = proto.Label.Value(f"LABEL_{label.upper()}")
            if kind[0].isupper():
                field.type_name = f".drivetrain.{kind}"
            else:
                field.type = proto.Type.Value(f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return pool


@functools.cache
def _message_class(name: str) -> type[Message]:
    """Returns the class of a message of the schema."""
    descriptor = _pool().FindMessageTypeByName(f"drivetrain.{name}")
    return message_factory.GetMessageClass(descriptor)


def parse(name: str, data: bytes) -> Any:
    """Parses a message of the schema; its attributes are the fields.

    Args:
        name: of the message, in the schema of this file.
        data: the message as it stands in the file.

    Returns:
        The message. Repeated numbers may be packed or not; unknown fields are skipped.

    Raises:
        ScenarioError: if the bytes are no such message.
    """
    try:
        return _message_class(name).FromString(data)
    except DecodeError as error:
        raise ScenarioError(
            f"{len(data)} bytes are no {name} message; the record is damaged or of "
            "another kind"
        ) from error


@functools.cache
def _layout(name: str) -> tuple[np.dtype, dict[str, int]]:
    """Returns how a message looks that has all its fields in order, and its tags."""
    tags = {
        f"tag_{field}": number << 3 | _WIRE_TYPES[kind]
        for _, kind, field, number in _fields(name)
    }
    values = {field: _DTYPES[kind] for _, kind, field, _ in _fields(name)}
    members = zip(tags, values.items(), strict=True)
    dtype = np.dtype([part for tag, value in members for part in ((tag, "u1"), value)])
    return dtype, tags


def columns(
    name: str, messages: list[bytes]
) -> dict[str, Shaped[np.ndarray, " messages"]]:
    """Decodes many messages of numbers into one array for each field.

    Messages that have every field, in order, share one length and one layout and are
    read with a single view. The others are parsed one by one, equal ones once.

    Args:
        name: of the message, in the schema of this file; its fields are double, float
            or bool with a number below 16.
        messages: as they stand in the file.

    Returns:
        The fields by name, zero where a message lacks one; a bool is 0 or 1.

    Raises:
        ScenarioError: if the bytes are no such message.
    """
    dtype, tags = _layout(name)
    lengths = np.fromiter(map(len, messages), np.int64, len(messages))
    is_regular = lengths == dtype.itemsize
    rows = np.zeros(len(messages), dtype)
    joined = b"".join(itertools.compress(messages, is_regular))
    rows[is_regular] = np.frombuffer(joined, dtype)
    for tag, value in tags.items():
        is_regular &= rows[tag] == value
    fields = [field for field in rows.dtype.fields or () if field not in tags]
    for field in fields:
        if rows.dtype[field] == np.uint8:
            is_regular &= rows[field] < 0x80  # more is a bool of several bytes
            rows[field] = rows[field] != 0

    irregular = list(itertools.compress(messages, ~is_regular))
    place = {data: index for index, data in enumerate(dict.fromkeys(irregular))}
    parsed = [parse(name, data) for data in place]
    index = np.fromiter((place[data] for data in irregular), np.int64, len(irregular))
    for field in fields:
        values = [getattr(message, field) for message in parsed]
        rows[field][~is_regular] = np.array(values, rows.dtype[field])[index]
    return {field: rows[field] for field in fields}


def looks_like_example(payload: bytes) -> bool:
    """Whether a payload, or its beginning, is a tf.Example rather than a Scenario."""
    return bool(_EXAMPLE_HEAD.match(payload) or _EXAMPLE_KEY.search(payload[:256]))


def features(example: bytes) -> dict[str, bytes]:
    """Returns the features of a tf.Example by name, each still to be decoded.

    Raises:
        ScenarioError: if the bytes are no tf.Example.
    """
    entries = parse("Example", example).features.feature
    return {entry.key.decode(errors="replace"): entry.value for entry in entries}


def numbers(feature: bytes) -> Shaped[np.ndarray, " values"]:
    """Returns the values of a feature of numbers: float32 or int64, as it holds them.

    Raises:
        ScenarioError: if the bytes are no feature.
    """
    packed = parse("PackedFeature", feature).float_list
    data = b"".join(packed.value)
    # Declared as bytes, the list shows packed floats alone; others are unknown fields.
    if data and len(data) % 4 == 0 and not unknown_fields.UnknownFieldSet(packed):
        return np.frombuffer(data, "<f4")
    parsed = parse("Feature", feature)
    floats, integers = parsed.float_list.value, parsed.int64_list.value
    if floats:
        return np.fromiter(floats, np.float32, len(floats))
    return np.fromiter(integers, np.int64, len(integers))


def texts(feature: bytes) -> list[bytes]:
    """Returns the values of a feature of texts.

    Raises:
        ScenarioError: if the bytes are no feature.
    """
    return list(parse("Feature", feature).bytes_list.value)
