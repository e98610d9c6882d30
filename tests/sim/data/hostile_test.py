"""Tests that no file, however damaged or malicious, does more than end in a sentence.

Each reader reads damaged scenarios and attacks in a process of its own, whose memory is
limited and which is ended when a file takes too long: a crash, a hang or a bomb fails
the test. `pytest tests/sim/data/hostile_test.py --mutations 10000 -s` reads so many
damaged files with each reader, and prints what became of them.
"""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

from drivetrain.sim.data import build
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import Scenario
from tests.sim.data import hostile
from tests.sim.data.formats import FORMATS

ROOT = pathlib.Path(__file__).resolve().parents[3]
READERS = [reader.name for reader in build.READERS]
NUM_TYPED = 25  # mutations that are read while every annotation is checked
SEED = 0


@pytest.mark.parametrize("name", READERS)
def test_every_reader_is_attacked(name: str) -> None:
    assert name in FORMATS, f"describe the files of {name} in tests/sim/data/formats.py"
    assert FORMATS[name].attacks()


@pytest.mark.parametrize("name", READERS)
def test_hostile_files_end_in_scenarios_or_sentences(
    name: str, request: pytest.FixtureRequest
) -> None:
    num_mutations = request.config.getoption("--mutations")
    command = [sys.executable, "-m", "tests.sim.data.hostile", name]
    done = subprocess.run(
        [*command, str(num_mutations), str(SEED)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-5000:]
    report = hostile.Report(**json.loads(done.stdout))
    print(f"\n{name}: {report}")
    assert report.failures == []
    assert report.num_files == num_mutations + len(FORMATS[name].attacks())
    # Damage that always, or never, stops a reader would prove little.
    assert report.num_scenarios > 0
    assert report.num_bad_records > 0


@pytest.mark.parametrize("name", READERS)
def test_annotations_hold_for_what_damaged_files_say(
    tmp_path: pathlib.Path, name: str
) -> None:
    for index in range(NUM_TYPED):
        contents = hostile.mutated_files(name, SEED + 1, index)
        found = build.read(FORMATS[name].put(tmp_path, contents))
        assert all(isinstance(item, Scenario | BadRecord) for item in found)


def test_a_mutation_can_be_made_again() -> None:
    first, again = (hostile.mutated_files("womd_json", SEED, 7) for _ in range(2))
    assert first == again
    assert first != hostile.mutated_files("womd_json", SEED, 8)


@pytest.mark.parametrize("name", READERS)
def test_mutations_change_files(name: str) -> None:
    plain = FORMATS[name].sealed(hostile.undamaged(name, 0))
    made = [hostile.mutated_files(name, SEED, index) for index in range(20)]
    assert plain not in made
    assert np.unique([str(contents) for contents in made]).size > 15
