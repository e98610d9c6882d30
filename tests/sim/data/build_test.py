"""Tests that any file ends in scenarios or in sentences."""

import dataclasses
import gzip
import os
import pathlib
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import orjson
import pytest

from drivetrain.sim.data import build
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import Scenario
from tests.sim.data import files, protos

NUM_MUTATIONS = 150
NOT_MUCH = 0.05  # of the bytes of the records: what the interpreter itself keeps
ABSURD = (None, -1, 2**63, 1e308, "x", [], {}, True, [[1]], {"x": None})


def example_record(wanted: Scenario) -> bytes:
    """Encodes a scenario as a tf.Example."""
    return protos.example_proto(wanted.scenario_id, protos.example_features(wanted))


def json_file(wanted: Scenario) -> bytes:
    """Encodes a scenario as JSON."""
    return orjson.dumps(files.json_document(wanted))


FILES: dict[str, Callable[[Scenario], bytes]] = {
    "womd_example": lambda wanted: files.tfrecord(example_record(wanted)),
    "womd_scenario": lambda wanted: files.tfrecord(protos.scenario_proto(wanted)),
    "womd_json": json_file,
}
RECORDS = {"womd_example": example_record, "womd_scenario": protos.scenario_proto}


def read(folder: pathlib.Path, data: bytes) -> list[Scenario | BadRecord]:
    """Writes a file and reads it back."""
    path = folder / "log"
    path.write_bytes(data)
    return list(build.read(path))


def reason(found: list[Scenario | BadRecord]) -> str:
    """Returns why the only record of a file cannot be used."""
    (bad,) = found
    assert isinstance(bad, BadRecord)
    return bad.reason


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("compress", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_the_format_is_told_from_the_content(
    tmp_path: pathlib.Path, name: str, compress: Callable[[bytes], bytes]
) -> None:
    wanted = files.scenario()
    (found,) = read(tmp_path, compress(FILES[name](wanted)))
    assert isinstance(found, Scenario)
    assert found.dataset == name
    assert found.scenario_id == wanted.scenario_id
    assert files.differences(found.tracks, wanted.tracks) == []


@pytest.mark.parametrize("name", FILES)
def test_one_reader_recognizes_a_file(name: str) -> None:
    head = FILES[name](files.scenario())
    names = [reader.name for reader in build.READERS if reader.recognizes(head)]
    assert names == [name]


def test_every_record_of_a_file_is_read(tmp_path: pathlib.Path) -> None:
    wanted = [files.scenario(seed) for seed in range(3)]
    found = read(tmp_path, files.tfrecord(*map(protos.scenario_proto, wanted)))
    ids = [item.scenario_id for item in found if isinstance(item, Scenario)]
    assert ids == [item.scenario_id for item in wanted]


def test_a_log_without_a_future_is_too_short(tmp_path: pathlib.Path) -> None:
    short = files.without_future(files.scenario())
    for name in FILES:
        assert "too short: 11 steps" in reason(read(tmp_path, FILES[name](short)))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file is empty"),
        (gzip.compress(b"", mtime=0), "the file is empty"),
        (
            bytes(100),
            "no known format; known: womd_example, womd_scenario, argoverse2, "
            "commonroad, womd_json",
        ),
        (b"OBJ1 is a head of another format", "no known format"),
        (b"PAR1 is a head of parquet", "the parquet data are damaged"),
        (b"{]", "the text is no valid JSON"),
        (
            gzip.compress(b"{" * 100, mtime=0)[:20],
            "the gzip data are damaged or cut off",
        ),
        (files.tfrecord(b""), "no scenario_id or no tracks"),
        (files.tfrecord(b"garbage"), "no Scenario message"),
    ],
)
def test_a_bad_file_is_named(
    tmp_path: pathlib.Path, data: bytes, sentence: str
) -> None:
    assert sentence in reason(read(tmp_path, data))


def test_a_value_that_is_not_finite_is_named(tmp_path: pathlib.Path) -> None:
    wanted = files.scenario()
    wanted.tracks.xyz[-1, 12, 1] = np.nan
    for name in RECORDS:
        sentence = "tracks.xyz[4, 12, 1] is nan: not a finite number"
        assert sentence in reason(read(tmp_path, FILES[name](wanted)))


def test_a_value_beyond_the_earth_is_named(tmp_path: pathlib.Path) -> None:
    wanted = files.scenario()
    wanted.roads.xyz[3, 0] = 1e30
    for name in FILES:
        assert "roads.xyz[3, 0] is" in reason(read(tmp_path, FILES[name](wanted)))


def test_paths_that_are_no_files_are_errors(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none; check"):
        build.read(tmp_path / "none")
    with pytest.raises(IsADirectoryError, match="is a folder; name the files in it"):
        build.read(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_a_file_that_may_not_be_read_is_an_error(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "secret"
    path.touch(mode=0)
    with pytest.raises(PermissionError, match="may not be read; check its owner"):
        build.read(path)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("compress", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_damaged_files_end_in_scenarios_or_sentences(
    tmp_path: pathlib.Path, name: str, compress: Callable[[bytes], bytes]
) -> None:
    rng = np.random.default_rng(0)
    data = compress(FILES[name](files.scenario(num_steps=13)))
    for _ in range(NUM_MUTATIONS):
        found = read(tmp_path, files.mutated(data, rng))
        assert all(isinstance(item, Scenario | BadRecord) for item in found)


@pytest.mark.parametrize("name", RECORDS)
def test_damage_that_no_checksum_sees_ends_in_a_scenario_or_a_sentence(
    tmp_path: pathlib.Path, name: str
) -> None:
    rng = np.random.default_rng(0)
    record = RECORDS[name](files.scenario(num_steps=13))
    for _ in range(2 * NUM_MUTATIONS):
        (found,) = read(tmp_path, files.tfrecord(files.mutated(record, rng)))
        assert isinstance(found, Scenario | BadRecord)


def test_absurd_values_in_json_end_in_a_scenario_or_a_sentence(
    tmp_path: pathlib.Path,
) -> None:
    rng = np.random.default_rng(0)
    for _ in range(2 * NUM_MUTATIONS):
        document = files.json_document(files.scenario(num_steps=13))
        replace_some_part(document, rng)
        (found,) = read(tmp_path, orjson.dumps(document))
        assert isinstance(found, Scenario | BadRecord)


def replace_some_part(part: Any, rng: np.random.Generator) -> None:
    """Puts an absurd value in a place that a random walk from the top comes to."""
    while True:
        places = list(part) if isinstance(part, dict) else range(len(part))
        place = places[int(rng.integers(len(places)))]
        below = part[place]
        if not isinstance(below, dict | list) or not below or rng.random() < 0.2:
            part[place] = ABSURD[int(rng.integers(len(ABSURD)))]
            return
        part = below


# Without the type checks of the tests, which remember each call.
PEAK_OF_READING = """
import gc, pathlib, sys, tracemalloc
from drivetrain.sim.data import build
from drivetrain.sim.scenario import Scenario

for name in sys.argv[1:]:
    tracemalloc.start()
    num_read = 0
    for item in build.read(pathlib.Path(name)):
        num_read += isinstance(item, Scenario)
        gc.collect()  # what waits for collection is not held
    print(num_read, tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
"""


def test_memory_does_not_grow_with_the_number_of_records(
    tmp_path: pathlib.Path,
) -> None:
    record = protos.scenario_proto(files.scenario())
    counts = (1, 3, 103)  # the first reading loads what all share
    names = [str(tmp_path / str(count)) for count in counts]
    for name, count in zip(names, counts, strict=True):
        pathlib.Path(name).write_bytes(files.tfrecord(*[record] * count))
    command = [sys.executable, "-c", PEAK_OF_READING, *names]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = [tuple(map(int, line.split())) for line in shown.splitlines()]
    assert [num_read for num_read, _ in found] == list(counts)
    assert found[2][1] - found[1][1] < NOT_MUCH * 100 * len(record)


def test_scenarios_of_two_formats_agree(tmp_path: pathlib.Path) -> None:
    wanted = files.scenario(seed=5)
    one, *others = (read(tmp_path, FILES[name](wanted))[0] for name in FILES)
    for other in others:
        assert isinstance(one, Scenario)
        assert isinstance(other, Scenario)
        same_name = dataclasses.replace(
            other, dataset=one.dataset, lane_links=one.lane_links
        )
        assert files.differences(same_name, one) == []
