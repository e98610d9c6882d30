"""Tests of the reader of the binary maps of PufferDrive."""

import dataclasses
import functools
import pathlib
import struct
from collections.abc import Callable

import numpy as np
import pytest

from drivetrain.sim.data import parts, pufferdrive
from drivetrain.sim.scenario import MapType, Scenario, ScenarioError
from tests.sim.data import files, puffer, sides

REAL_FILE = files.REAL_DATA / "pufferdrive/map_942.bin"
SPEED_ERROR = 0.2  # metres per second: places are rounded to a centimetre, 0.1 s apart
SLOW = 1.0  # metres per second, below which nothing can be told from noise
NUM_STEPS = 13


def plainest(kind: int) -> MapType:
    """Returns what is left of a MapType when only its kind is told."""
    if kind <= MapType.LANE_BIKE:
        return MapType.LANE_UNDEFINED
    if kind < MapType.EDGE_UNKNOWN:
        return MapType.LINE_UNKNOWN
    return MapType.EDGE_BOUNDARY if kind < MapType.STOP_SIGN else MapType(kind)


def written(seed: int = 0) -> Scenario:
    """Returns a scenario as the reader should name it."""
    wanted = files.scenario(seed, NUM_STEPS)
    kinds = [plainest(int(kind)) for kind in wanted.roads.map_type]
    is_of_interest = np.zeros(len(wanted.tracks.valid), bool)
    return dataclasses.replace(
        wanted,
        scenario_id="map_007",
        dataset="pufferdrive",
        ego_source="last",
        tracks=dataclasses.replace(wanted.tracks, is_of_interest=is_of_interest),
        roads=dataclasses.replace(wanted.roads, map_type=np.array(kinds)),
        lights=parts.no_lights(NUM_STEPS),
        lane_links=None,
        assumptions=pufferdrive.ASSUMPTIONS,
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_scenario_comes_back(tmp_path: pathlib.Path, seed: int) -> None:
    path = tmp_path / "map_007.bin"
    path.write_bytes(puffer.puffer_file(files.scenario(seed, NUM_STEPS)))
    (found,) = pufferdrive.READER.records(path)
    assert files.differences(found, written(seed)) == []


def test_the_assumptions_are_told() -> None:
    assert written().assumptions == (
        "steps of 0.1 s",
        "kinds of lanes, lines and edges",
        "no lights in the file",
        "ego: chosen among the vehicles",
        "lane links from lane ends, no speed limits",
    )


OBJECT_BYTES = 12 + 32 * NUM_STEPS + 28
FIRST_ROAD = 8 + 5 * OBJECT_BYTES


@pytest.mark.parametrize(
    ("at", "value", "sentence"),
    [
        (0, 0, "the file claims 0 objects; at least 1"),
        (0, -1, "the file claims -1 objects"),
        (0, 2**31 - 1, "object 9 of 2147483647, of the length .* does not fit"),
        (4, 0, "the file claims 0 roads"),
        (4, 2**31 - 1, "road 11 of 2147483647, of the length 0, does not fit"),
        (4, 10, "bytes follow the last road"),
        (16, 2**31 - 1, "object 0 of 5, of the length 2147483647, does not fit"),
        (16, -1, "object 0 of 5, of the length -1, does not fit"),
        (FIRST_ROAD, 3, "road 0 is of type 3; known are 4, 5, 6, 7, 8, 9, 10"),
        (FIRST_ROAD + 8, 2**30, "road 0 of 11, of the length 1073741824"),
    ],
)
def test_counts_that_lie_are_named(at: int, value: int, sentence: str) -> None:
    data = bytearray(puffer.puffer_file(files.scenario(0, NUM_STEPS)))
    data[at : at + 4] = struct.pack("<i", value)
    with pytest.raises(ScenarioError, match=sentence):
        pufferdrive.convert(bytes(data), "file")


def test_objects_must_have_the_same_steps() -> None:
    one = puffer.puffer_file(files.scenario(0, NUM_STEPS))[8:][:OBJECT_BYTES]
    other = puffer.puffer_file(files.scenario(0, NUM_STEPS + 1))
    data = struct.pack("<ii", 6, 11) + one + other[8:]
    with pytest.raises(ScenarioError, match="the objects have 13 to 14 steps"):
        pufferdrive.convert(data, "file")


def test_every_cut_file_is_refused() -> None:
    data = puffer.puffer_file(files.scenario(0, NUM_STEPS))
    for end in range(0, len(data), 7):
        with pytest.raises(ScenarioError, match=r"the file ends|does not fit"):
            pufferdrive.convert(data[:end], "file")


@pytest.mark.parametrize(
    "head",
    [
        bytes(100),
        b'{"objects": [], "roads": [], "name": "of the same length"}',
        files.tfrecord(b"x" * 100),
        struct.pack("<5i", 5, 11, 9, 1, 91),
        struct.pack("<5i", 5, 11, 1, 1, 0),
        struct.pack("<5i", 5, 0, 1, 1, 91),
        struct.pack("<4i", 5, 11, 1, 1),
    ],
)
def test_other_heads_are_not_recognized(head: bytes) -> None:
    assert not pufferdrive.READER.recognizes(head)


@functools.cache
def real() -> Scenario:
    """Reads the real file."""
    (found,) = pufferdrive.READER.records(REAL_FILE)
    assert isinstance(found, Scenario)
    return found


def of_real_file(test: Callable[[], None]) -> Callable[[], None]:
    """Runs a test where the real file is."""
    return pytest.mark.skipif(not REAL_FILE.exists(), reason=files.NO_REAL_DATA)(test)


@of_real_file
def test_everything_of_the_real_file_is_there() -> None:
    words = np.frombuffer(REAL_FILE.read_bytes(), "<i4")
    num_objects, num_roads = words[:2]
    # Objects of 91 steps have 3 + 8 * 91 + 7 words, the validity before the last 7.
    objects = words[2 : 2 + 738 * num_objects].reshape(-1, 738)
    found = real()
    assert found.tracks.valid.shape == (79, 91) == (num_objects, objects[0, 2])
    assert np.array_equal(found.tracks.valid, objects[:, 640:731] == 1)
    assert found.tracks.object_id.tolist() == objects[:, 1].tolist()
    assert found.roads.num_features == num_roads == 608
    # What is no road's title, tail, count or closing point is its points.
    closed = np.isin(found.roads.map_type, files.POLYGONS).sum()
    num_words = len(words) - 2 - objects.size - 10 * num_roads
    assert len(found.roads.xyz) - closed == num_words / 3


@of_real_file
def test_real_objects_move_as_fast_as_they_say() -> None:
    tracks = real().tracks
    both = tracks.valid[:, 1:] & tracks.valid[:, :-1]
    step = np.diff(tracks.xyz[..., :2], axis=1) / 0.1
    mean = (tracks.velocity[:, 1:] + tracks.velocity[:, :-1]) / 2
    error = np.linalg.norm(step - mean, axis=-1)[both]
    moving = np.linalg.norm(mean, axis=-1)[both] > SLOW
    assert np.median(error[moving]) < SPEED_ERROR


@of_real_file
def test_the_real_ego_keeps_to_the_left_of_the_edges() -> None:
    assert real().ego_source == "last"
    assert sides.share_left_of_edges(real()) == 1.0
