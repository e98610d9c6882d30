"""Reads damaged and hostile files in a process of its own, under limits.

`python -m tests.sim.data.hostile NAME NUM_MUTATIONS SEED` damages scenarios of one
format so often, reads each, reads the attacks on the format as well, and prints a
`Report` as JSON. What crashes, hangs or takes the memory ends the process alone. A
mutation is made again by `mutated_files(name, seed, index)`.
"""

import dataclasses
import faulthandler
import functools
import gzip
import json
import pathlib
import resource
import sys
import tempfile
import time
import traceback

import numpy as np

from drivetrain.sim.data import build
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import Scenario
from tests.sim.data import files, mutations
from tests.sim.data.formats import FORMATS, Files

MEMORY = 2 << 30  # bytes that reading may take: the largest record, unfolded, thrice
SECONDS = 60  # for one file, far beyond any: what is endless is to be seen, not timed
NUM_STEPS, NUM_SEEDS = 13, 4
MOST_FAILURES = 5


@dataclasses.dataclass(kw_only=True)
class Report:
    """What became of the files."""

    num_files: int = 0
    num_scenarios: int = 0
    num_bad_records: int = 0
    seconds: float = 0.0
    slowest_seconds: float = 0.0
    slowest: str = ""
    peak_bytes: int = 0  # of the process, its libraries included
    failures: list[str] = dataclasses.field(default_factory=list)


@functools.cache
def undamaged(name: str, seed: int) -> Files:
    """Returns the files of a scenario."""
    return FORMATS[name].write(files.scenario(seed, NUM_STEPS))


def mutated_files(name: str, seed: int, index: int) -> Files:
    """Returns the files of a scenario with a damage that the numbers determine.

    A file that has a checksum is damaged before or after it is sealed, a document by
    its parts or its bytes, and one of eight files is compressed before or after.
    """
    rng = np.random.default_rng([seed, index])
    made = FORMATS[name]
    number = int(rng.integers(NUM_SEEDS))
    if made.document is not None and rng.random() < 0.5:
        document = made.document(files.scenario(number, NUM_STEPS))
        damaged = mutations.replaced(document, rng, made.absurd)
        contents = made.sealed(undamaged(name, number) | made.dump(damaged))
    else:
        contents = dict(undamaged(name, number))
        part = list(contents)[int(rng.integers(len(contents)))]
        if rng.random() < 0.75:
            contents[part] = mutations.damaged(contents[part], rng)
            contents = made.sealed(contents)
        else:
            contents = made.sealed(contents)
            contents[part] = mutations.damaged(contents[part], rng)
    if rng.random() < 0.125:
        part = list(contents)[int(rng.integers(len(contents)))]
        contents[part] = gzip.compress(contents[part], compresslevel=1)
        if rng.random() < 0.5:
            contents[part] = mutations.damaged(contents[part], rng)
    return contents


def read(name: str, contents: Files, label: str, report: Report) -> None:
    """Reads files and adds to the report what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        path = FORMATS[name].put(pathlib.Path(folder), contents)
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        before = time.perf_counter()
        try:
            for item in build.read(path):
                report.num_scenarios += isinstance(item, Scenario)
                report.num_bad_records += isinstance(item, BadRecord)
                assert isinstance(item, Scenario | BadRecord)
        except Exception:  # nothing at all may be raised
            report.failures.append(f"{label}: {traceback.format_exc(limit=-4)}")
        seconds = time.perf_counter() - before
        faulthandler.cancel_dump_traceback_later()
    report.num_files += 1
    report.seconds += seconds
    if seconds > report.slowest_seconds:
        report.slowest_seconds, report.slowest = seconds, label


def main(name: str, num_mutations: int, seed: int) -> None:
    """Reads everything and prints the report."""
    in_use = int(pathlib.Path("/proc/self/statm").read_text().split()[0])
    limit = in_use * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    faulthandler.enable()
    report = Report()
    made = FORMATS[name]
    whole = made.sealed(undamaged(name, 0))
    for label, contents in made.attacks().items():
        read(name, whole | contents, label, report)
    for index in range(num_mutations):
        if len(report.failures) < MOST_FAILURES:
            read(name, mutated_files(name, seed, index), f"mutation {index}", report)
    report.peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps(dataclasses.asdict(report)))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
