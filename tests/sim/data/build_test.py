"""Tests that any file ends in scenarios or in sentences."""

import dataclasses
import gzip
import math
import os
import pathlib
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from drivetrain.sim.data import build
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import Scenario
from tests.sim.data import files, protos
from tests.sim.data.formats import FORMATS

NOT_MUCH = 0.4  # of the bytes of the records: caches of libraries may grow by 1 MB
# 2 mm, of which float32 at 20 km takes 1, and 0.1 degrees, whichever is the stricter.
AGREEMENT = min(0.002, math.radians(0.1))
ROUNDING = 1e-12  # float64: speeds along the yaw times its sine and cosine
WITH_ANY_NUMBER = (
    *("womd_example", "womd_scenario", "scenarionet", "pufferdrive", "argoverse2"),
)
WITH_LANES_MADE_ANEW = ("argoverse2", "commonroad")


def read(folder: pathlib.Path, data: bytes) -> list[Scenario | BadRecord]:
    """Writes a file and reads it back."""
    path = folder / "log"
    path.write_bytes(data)
    return list(build.read(path))


def written(
    folder: pathlib.Path, name: str, wanted: Scenario
) -> list[Scenario | BadRecord]:
    """Writes a scenario in a format and reads it back."""
    made = FORMATS[name]
    return list(build.read(made.put(folder, made.sealed(made.write(wanted)))))


def reason(found: list[Scenario | BadRecord]) -> str:
    """Returns why the only record of a file cannot be used."""
    (bad,) = found
    assert isinstance(bad, BadRecord)
    return bad.reason


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("compress", [bytes, gzip.compress], ids=["plain", "gzip"])
def test_the_format_is_told_from_the_content(
    tmp_path: pathlib.Path, name: str, compress: Callable[[bytes], bytes]
) -> None:
    wanted, made = files.scenario(), FORMATS[name]
    contents = made.sealed(made.write(wanted))
    squeezed = {part: compress(content) for part, content in contents.items()}
    (found,) = build.read(made.put(tmp_path, squeezed))
    assert isinstance(found, Scenario)
    assert found.dataset == name
    carried = made.compared(made.carried(wanted))
    assert found.scenario_id == carried.scenario_id
    tracks = made.compared(found).tracks
    assert files.differences(tracks, carried.tracks, ROUNDING) == []


@pytest.mark.parametrize("name", FORMATS)
def test_one_reader_recognizes_a_file(name: str) -> None:
    made = FORMATS[name]
    head = made.sealed(made.write(files.scenario()))[made.attacked]
    names = [reader.name for reader in build.READERS if reader.recognizes(head)]
    assert names == [name]


def test_every_record_of_a_file_is_read(tmp_path: pathlib.Path) -> None:
    wanted = [files.scenario(seed) for seed in range(3)]
    found = read(tmp_path, files.tfrecord(*map(protos.scenario_proto, wanted)))
    ids = [item.scenario_id for item in found if isinstance(item, Scenario)]
    assert ids == [item.scenario_id for item in wanted]


def test_a_log_without_a_future_is_too_short(tmp_path: pathlib.Path) -> None:
    short = files.without_future(files.scenario())
    for name in FORMATS:
        assert "too short: 11 steps" in reason(written(tmp_path, name, short))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "the file is empty"),
        (gzip.compress(b"", mtime=0), "the file is empty"),
        (bytes(100), "meant to be womd_example, womd_scenario, argoverse2, commonroad"),
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
    for name in WITH_ANY_NUMBER:
        sentence = "tracks.xyz[4, 12, 1] is nan: not a finite number"
        assert sentence in reason(written(tmp_path, name, wanted))


def test_a_value_beyond_the_earth_is_named(tmp_path: pathlib.Path) -> None:
    wanted = files.scenario()
    wanted.roads.xyz[3, 0] = 1e30
    for name in FORMATS:
        place = "lane 11" if name in WITH_LANES_MADE_ANEW else "roads.xyz[3, 0]"
        assert f"{place} is " in reason(written(tmp_path, name, wanted))


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
    counts = (1, 3, 403)  # the first reading loads what all share
    names = [str(tmp_path / str(count)) for count in counts]
    for name, count in zip(names, counts, strict=True):
        pathlib.Path(name).write_bytes(files.tfrecord(*[record] * count))
    command = [sys.executable, "-c", PEAK_OF_READING, *names]
    shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found = [tuple(map(int, line.split())) for line in shown.splitlines()]
    assert [num_read for num_read, _ in found] == list(counts)
    assert found[2][1] - found[1][1] < NOT_MUCH * 400 * len(record)


def far_away(wanted: Scenario) -> Scenario:
    """Returns a scenario moved to where maps of cities put it: 23 km from zero."""
    tracks, roads, lights = wanted.tracks, wanted.roads, wanted.lights
    place = np.array([12_000.0, -20_000.0, 50.0])
    moved = (tracks.xyz + place) * tracks.valid[..., None]
    return dataclasses.replace(
        wanted,
        tracks=dataclasses.replace(tracks, xyz=moved),
        roads=dataclasses.replace(roads, xyz=roads.xyz + place),
        lights=dataclasses.replace(lights, xyz=lights.xyz + place),
    )


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("seed", range(3))
def test_scenarios_of_all_formats_agree(
    tmp_path: pathlib.Path, name: str, seed: int
) -> None:
    wanted, made = far_away(files.scenario(seed)), FORMATS[name]
    (found,) = build.read(made.put(tmp_path, made.sealed(made.write(wanted))))
    assert isinstance(found, Scenario)
    told = dataclasses.replace(found, dataset=wanted.dataset, assumptions=())
    carried = made.compared(made.carried(wanted))
    assert files.differences(made.compared(told), carried, AGREEMENT) == []
