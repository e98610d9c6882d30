"""Encodes scenarios as the protocol buffers of WOMD, byte by byte, for tests."""

import struct
from collections.abc import Iterable

import numpy as np

from drivetrain.sim.scenario import Lights, MapType, Scenario, Tracks
from tests.sim.data.files import METERS_PER_SECOND, POLYGONS, open_run

_POLYGON_FIELDS = {MapType.CROSSWALK: 8, MapType.SPEED_BUMP: 9, MapType.DRIVEWAY: 10}


def varint(value: int) -> bytes:
    """Encodes an integer, negative ones as 64 bits in two's complement."""
    value &= 2**64 - 1
    low = b""
    while value > 0x7F:
        low += bytes([value & 0x7F | 0x80])
        value >>= 7
    return low + bytes([value])


def field(number: int, value: bytes | float | np.float32 | int) -> bytes:
    """Encodes a field: bytes with a length, np.float32 in 4 bytes, floats in 8."""
    if isinstance(value, bytes):
        return varint(number << 3 | 2) + varint(len(value)) + value
    if isinstance(value, np.float32):
        return varint(number << 3 | 5) + struct.pack("<f", value)
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    return varint(number << 3) + varint(int(value))


def integers(number: int, values: Iterable[int], is_packed: bool) -> bytes:
    """Encodes a repeated integer."""
    if is_packed:
        return field(number, b"".join(varint(int(value)) for value in values))
    return b"".join(field(number, int(value)) for value in values)


def floats(number: int, values: np.ndarray, is_packed: bool) -> bytes:
    """Encodes a repeated float."""
    if is_packed:
        return field(number, values.astype("<f4").tobytes())
    return b"".join(field(number, value) for value in values.astype(np.float32).flat)


def map_point(xyz: np.ndarray) -> bytes:
    """Encodes a MapPoint."""
    return b"".join(field(axis + 1, float(xyz[axis])) for axis in range(3))


def scenario_proto(
    wanted: Scenario, *, is_packed: bool = True, state_tail: bytes = b""
) -> bytes:
    """Encodes a Scenario proto.

    Args:
        wanted: what to write.
        is_packed: whether repeated integers are packed.
        state_tail: unknown fields to add to every ObjectState and MapPoint.

    Returns:
        The message.
    """
    tracks = wanted.tracks
    steps = range(wanted.num_steps)
    timestamps = b"".join(field(1, step / 10) for step in steps)
    (predicted, *interesting) = tracks.is_of_interest.nonzero()[0].tolist()
    return b"".join(
        [
            timestamps,
            *(field(2, track_proto(tracks, i, state_tail)) for i in range(5)),
            field(3, b""),  # nobody declares it, and an official sample has it
            integers(4, tracks.object_id[interesting], is_packed),
            field(5, wanted.scenario_id.encode()),
            field(6, wanted.ego_index),
            *(field(7, light_proto(wanted.lights, step)) for step in steps),
            *(
                field(8, feature_proto(wanted, i, is_packed, state_tail))
                for i in range(wanted.roads.num_features)
            ),
            field(10, wanted.current_step),
            field(11, field(1, predicted) + field(2, 1)),
        ]
    )


def track_proto(tracks: Tracks, index: int, state_tail: bytes) -> bytes:
    """Encodes a Track; invalid states hold a height of the ground and no more."""
    states = []
    for step in range(tracks.valid.shape[1]):
        if tracks.valid[index, step]:
            center = (float(value) for value in tracks.xyz[index, step])
            rest = (
                *tracks.size[index].astype(np.float32),
                np.float32(tracks.yaw[index, step]),
                *tracks.velocity[index, step].astype(np.float32),
                1,
            )
            values = enumerate((*center, *rest), start=2)
            states.append(b"".join(field(number, value) for number, value in values))
        else:
            states.append(field(4, -3.25) + field(11, 0))
    return (
        field(1, int(tracks.object_id[index]))
        + field(2, int(tracks.object_type[index]))
        + b"".join(field(3, state + state_tail) for state in states)
    )


def light_proto(lights: Lights, step: int) -> bytes:
    """Encodes a DynamicMapState."""
    return b"".join(
        field(
            1,
            field(1, int(lights.lane_id[i]))
            + field(2, int(lights.state[i, step]))
            + field(3, map_point(lights.xyz[i])),
        )
        for i in lights.valid[:, step].nonzero()[0]
    )


def feature_proto(
    wanted: Scenario, index: int, is_packed: bool, point_tail: bytes
) -> bytes:
    """Encodes a MapFeature."""
    roads = wanted.roads
    kind, feature_id = int(roads.map_type[index]), int(roads.feature_id[index])
    points = [map_point(point) + point_tail for point in open_run(roads, index)]
    if kind <= MapType.LANE_BIKE:
        number, content = 3, lane_proto(wanted, kind, feature_id, points, is_packed)
    elif kind < MapType.EDGE_UNKNOWN:
        number, content = 4, field(1, kind - 5) + b"".join(field(2, p) for p in points)
    elif kind <= MapType.EDGE_MEDIAN:
        number, content = 5, field(1, kind - 14) + b"".join(field(2, p) for p in points)
    elif kind == MapType.STOP_SIGN:
        assert wanted.lane_links is not None
        stop = wanted.lane_links.stop
        lanes = stop[stop[:, 0] == feature_id, 1]
        number, content = 7, integers(1, lanes, is_packed) + field(2, points[0])
    else:
        number = _POLYGON_FIELDS[MapType(kind)]
        content = b"".join(field(1, point) for point in points)
    return field(1, feature_id) + field(number, content)


def lane_proto(
    wanted: Scenario, kind: int, feature_id: int, points: list[bytes], is_packed: bool
) -> bytes:
    """Encodes a LaneCenter; each link stands at both of its lanes."""
    assert wanted.lane_links is not None
    links = wanted.lane_links
    beside = links.neighbor[links.neighbor[:, 0] == feature_id, 1]
    left, right = beside[::2], beside[1::2]
    limit = links.limit[links.limited == feature_id]
    return b"".join(
        [
            *(field(1, float(v / METERS_PER_SECOND["mph"])) for v in limit),
            field(2, kind),
            *(field(8, point) for point in points),
            integers(
                9, links.successor[links.successor[:, 1] == feature_id, 0], is_packed
            ),
            integers(
                10, links.successor[links.successor[:, 0] == feature_id, 1], is_packed
            ),
            *(field(11, field(1, int(lane)) + field(2, 0)) for lane in left),
            *(field(12, field(1, int(lane)) + field(2, 0)) for lane in right),
        ]
    )


def example_features(wanted: Scenario, num_padding: int = 3) -> dict[str, np.ndarray]:
    """Returns the numbers of a tf.Example, each in its shape, with padding rows."""
    tracks, roads, current = wanted.tracks, wanted.roads, wanted.current_step

    def padded(values: np.ndarray, fill: float = -1.0) -> np.ndarray:
        width = [(0, num_padding)] + [(0, 0)] * (values.ndim - 1)
        return np.pad(values, width, constant_values=np.array(fill, values.dtype))

    flags = {
        "state/is_sdc": np.arange(len(tracks.valid)) == wanted.ego_index,
        "state/tracks_to_predict": tracks.is_of_interest & (tracks.object_type == 1),
        "state/objects_of_interest": tracks.is_of_interest & (tracks.object_type != 1),
    }
    features = {name: padded(flag.astype(np.int64)) for name, flag in flags.items()}
    features["state/id"] = padded(tracks.object_id.astype(np.float32))
    features["state/type"] = padded(tracks.object_type.astype(np.float32))
    size = np.broadcast_to(tracks.size[:, None], tracks.xyz.shape)
    columns = np.concatenate(
        [tracks.xyz, size, tracks.yaw[..., None], tracks.velocity], axis=-1
    ).astype(np.float32)
    columns[~tracks.valid] = -1.0
    names = "x y z length width height bbox_yaw velocity_x velocity_y".split()
    spans = {
        "past": slice(0, current),
        "current": slice(current, current + 1),
        "future": slice(current + 1, None),
    }
    for tense, span in spans.items():
        for index, name in enumerate(names):
            features[f"state/{tense}/{name}"] = padded(columns[:, span, index])
        features[f"state/{tense}/valid"] = padded(
            tracks.valid[:, span].astype(np.int64), 0
        )
        for name, values in _light_columns(wanted.lights).items():
            features[f"traffic_light_state/{tense}/{name}"] = values[span]
    num_points = np.diff(roads.offset)
    is_last = np.isin(np.arange(len(roads.xyz)) + 1, roads.offset)
    is_polygon = np.isin(np.repeat(roads.map_type, num_points), POLYGONS)
    kept = ~(is_last & is_polygon)
    point_id = np.repeat(roads.feature_id, num_points)[kept]
    features["roadgraph_samples/id"] = padded(point_id)
    features["roadgraph_samples/type"] = padded(
        np.repeat(roads.map_type, num_points)[kept]
    )
    features["roadgraph_samples/valid"] = padded(np.ones_like(point_id), 0)
    features["roadgraph_samples/xyz"] = padded(roads.xyz[kept].astype(np.float32))
    return features


def _light_columns(lights: Lights) -> dict[str, np.ndarray]:
    """Returns lights by step and slot, the slots filled from the left at each step."""
    num_lights, num_steps = lights.valid.shape
    columns = {
        name: np.full((num_steps, num_lights + 1), -1, np.int64)
        for name in ("id", "state", "valid")
    }
    columns["valid"][:] = 0
    places = {
        axis: np.full((num_steps, num_lights + 1), -1, np.float32) for axis in "xyz"
    }
    for step in range(num_steps):
        for slot, light in enumerate(lights.valid[:, step].nonzero()[0]):
            columns["id"][step, slot] = lights.lane_id[light]
            columns["state"][step, slot] = lights.state[light, step]
            columns["valid"][step, slot] = 1
            for index, axis in enumerate("xyz"):
                places[axis][step, slot] = lights.xyz[light, index]
    return columns | places


def example_proto(
    scenario_id: str, features: dict[str, np.ndarray], is_packed: bool = True
) -> bytes:
    """Encodes a tf.Example."""
    encoded = {"scenario/id": field(1, field(1, scenario_id.encode()))}
    for name, values in features.items():
        if values.dtype.kind == "f":
            encoded[name] = field(2, floats(1, values.ravel(), is_packed))
        else:
            encoded[name] = field(3, integers(1, values.ravel(), is_packed))
    entries = [
        field(1, field(1, name.encode()) + field(2, feature))
        for name, feature in encoded.items()
    ]
    return field(1, b"".join(entries))
