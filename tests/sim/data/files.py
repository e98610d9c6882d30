"""Writes scenarios as files of WOMD, for the tests of the readers.

Nothing of the code under test helps to write what it is to read. Absent values are
written as junk, as the data sets do. `protos` has the two protocol buffers.
"""

import dataclasses
import pathlib
import struct
from collections.abc import Callable, Sequence
from typing import Any

import google_crc32c
import numpy as np

from drivetrain.sim.scenario import (
    LaneLinks,
    Lights,
    LightState,
    MapType,
    ObjectType,
    Polylines,
    Scenario,
    Tracks,
)

REAL_DATA = pathlib.Path(__file__).resolve().parents[4] / "shared/data"
NO_REAL_DATA = "the real files of ../shared/data are not here"

METERS_PER_SECOND = {"mph": 0.44704, "kmh": 1 / 3.6}
POLYGONS = (MapType.CROSSWALK, MapType.SPEED_BUMP, MapType.DRIVEWAY)


def scenario(seed: int = 0, num_steps: int = 30) -> Scenario:
    """Returns a scenario of random values that float32 holds exactly."""
    rng = np.random.default_rng(seed)

    def draw(*shape: int, scale: float = 100.0) -> np.ndarray:
        return rng.uniform(-scale, scale, shape).astype(np.float32).astype(np.float64)

    object_type = np.array([1, 2, 3, 4, 1])
    num_objects = len(object_type)
    valid = rng.random((num_objects, num_steps)) < 0.7
    valid[0, 0] = False
    valid[-1] = True
    tracks = Tracks(
        object_id=rng.permutation(1000)[:num_objects],
        object_type=object_type,
        xyz=draw(num_objects, num_steps, 3) * valid[..., None],
        yaw=draw(num_objects, num_steps, scale=3.14) * valid,
        velocity=draw(num_objects, num_steps, 2, scale=20.0) * valid[..., None],
        valid=valid,
        size=np.abs(draw(num_objects, 3, scale=5.0)),
        is_of_interest=np.array([True, False, True, False, False]),
    )
    lit = rng.random((2, num_steps)) < 0.5
    lit[:, 0] = True
    lights = Lights(
        lane_id=np.array([11, 12]),
        xyz=draw(2, 3),
        state=rng.integers(0, 7, (2, num_steps)) * lit,
        valid=lit,
    )
    return Scenario(
        scenario_id=f"{seed:016x}",
        dataset="",
        tracks=tracks,
        ego_index=num_objects - 1,
        ego_source="marked",
        roads=roads(draw),
        lights=lights,
        lane_links=LaneLinks(
            successor=np.array([[11, 12], [12, 13], [90, 11]]),
            neighbor=np.array([[11, 13], [13, 11]]),
            stop=np.array([[18, 11], [18, 12]]),
            limited=np.array([11, 12]),
            limit=np.array([25.0, 35.0]) * METERS_PER_SECOND["mph"],
        ),
    )


def roads(draw: Callable[..., np.ndarray]) -> Polylines:
    """Returns features of every kind, each with random points and a closed polygon."""
    map_type = [2, 1, 3, 7, 13, 15, 16, 17, 18, 19, 20]
    runs = []
    for kind in map_type:
        run = draw(1 if kind == MapType.STOP_SIGN else 5, 3)
        if kind in POLYGONS:
            run[-1] = run[0]
        runs.append(run)
    return Polylines(
        xyz=np.concatenate(runs),
        offset=np.cumsum([0] + [len(run) for run in runs]),
        map_type=np.array(map_type),
        feature_id=np.arange(11, 11 + len(runs)),
    )


def without_future(wanted: Scenario) -> Scenario:
    """Returns the scenario cut after the current step."""
    end = wanted.current_step + 1
    tracks, lights = wanted.tracks, wanted.lights
    return dataclasses.replace(
        wanted,
        tracks=dataclasses.replace(
            tracks,
            xyz=tracks.xyz[:, :end],
            yaw=tracks.yaw[:, :end],
            velocity=tracks.velocity[:, :end],
            valid=tracks.valid[:, :end],
        ),
        lights=dataclasses.replace(
            lights, state=lights.state[:, :end], valid=lights.valid[:, :end]
        ),
    )


def differences(found: Any, wanted: Any, tolerance: float = 0.0, at: str = "") -> list:
    """Names the fields in which two records differ."""
    if dataclasses.is_dataclass(wanted):
        names = [field.name for field in dataclasses.fields(wanted)]
        return [
            line
            for name in names
            for line in differences(
                getattr(found, name), getattr(wanted, name), tolerance, f"{at}.{name}"
            )
        ]
    if isinstance(wanted, np.ndarray):
        if np.shape(found) != wanted.shape:
            return [f"{at}: {np.shape(found)} is not {wanted.shape}"]
        is_same = np.allclose(found, wanted, rtol=0.0, atol=tolerance)
    else:
        is_same = found == wanted
    return [] if is_same else [f"{at}: {found} is not {wanted}"]


def open_run(roads: Polylines, feature: int) -> np.ndarray:
    """Returns the points of a feature as files hold them: polygons are not closed."""
    is_polygon = roads.map_type[feature] in POLYGONS
    return roads.points_of(feature)[: -1 if is_polygon else None]


def tfrecord(*payloads: bytes) -> bytes:
    """Frames payloads as a TFRecord."""
    return b"".join(frame(payload) for payload in payloads)


def frame(payload: bytes) -> bytes:
    """Frames one payload: its length, a checksum, itself, a checksum."""
    length = struct.pack("<Q", len(payload))
    return length + checksum(length) + payload + checksum(payload)


def checksum(data: bytes) -> bytes:
    """Returns the masked CRC-32C."""
    crc = google_crc32c.value(data)
    return struct.pack("<I", (((crc >> 15) | (crc << 17)) + 0xA282EAD8) % 2**32)


def json_document(wanted: Scenario, *, in_degrees: bool = False) -> dict[str, Any]:
    """Returns what a JSON file of WOMD says, in its newer form."""
    tracks, roads, lights = wanted.tracks, wanted.roads, wanted.lights
    objects = []
    for i in range(len(tracks.valid)):
        valid = tracks.valid[i]
        yaw = np.degrees(tracks.yaw[i]) if in_degrees else tracks.yaw[i]
        objects.append(
            {
                "position": records(tracks.xyz[i], valid),
                "velocity": records(tracks.velocity[i], valid),
                "heading": np.where(valid, yaw, -10000.0).tolist(),
                "valid": valid.tolist(),
                "length": float(tracks.size[i, 0]),
                "width": float(tracks.size[i, 1]),
                "height": float(tracks.size[i, 2]),
                "type": ObjectType(tracks.object_type[i]).name.lower(),
                "id": int(tracks.object_id[i]),
            }
        )
    (predicted, *interesting) = tracks.is_of_interest.nonzero()[0].tolist()
    return {
        "name": "made by a test",
        "scenario_id": wanted.scenario_id,
        "objects": objects,
        "roads": [
            {
                "type": word(int(roads.map_type[i])),
                "map_element_id": int(roads.map_type[i]),
                "id": int(roads.feature_id[i]),
                "geometry": records(open_run(roads, i)),
            }
            for i in range(roads.num_features)
        ],
        "tl_states": {
            str(lights.lane_id[i]): light_record(lights, i)
            for i in range(len(lights.lane_id))
        },
        "metadata": {
            "sdc_track_index": wanted.ego_index,
            "objects_of_interest": tracks.object_id[interesting].tolist(),
            "tracks_to_predict": [{"track_index": predicted, "difficulty": 0}],
        },
    }


def word(kind: int) -> str:
    """Returns the word of JSON for a MapType."""
    if kind >= MapType.STOP_SIGN:
        return MapType(kind).name.lower()
    return "lane" if kind < 4 else "road_line" if kind < 14 else "road_edge"


def records(
    vectors: np.ndarray, valid: Sequence[bool] | np.ndarray | None = None
) -> list[dict[str, float]]:
    """Returns vectors as x, y and maybe z, with -10000 where they are not valid."""
    if valid is not None:
        vectors = np.where(np.asarray(valid)[:, None], vectors, -10000.0)
    return [dict(zip("xyz", row, strict=False)) for row in vectors.tolist()]


def light_record(lights: Lights, index: int) -> dict[str, Any]:
    """Returns what JSON says of one light: the steps at which it was seen."""
    steps = lights.valid[index].nonzero()[0]
    place = {
        axis: [float(lights.xyz[index, k])] * len(steps) for k, axis in enumerate("xyz")
    }
    words = [LightState(lights.state[index, step]).name.lower() for step in steps]
    return {"state": words, "time_index": steps.tolist(), **place}
