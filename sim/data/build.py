"""Reads scenarios from a file of any known format."""

import os
import pathlib
from collections.abc import Iterator

import numpy as np

from .. import scenario
from ..scenario import Scenario, ScenarioError
from . import (
    argoverse2,
    base,
    commonroad,
    json_scenes,
    pufferdrive,
    scenarionet,
    timeline as timelines,
    womd_example,
    womd_scenario,
)
from .base import BadRecord
from .timeline import Timeline

# In this order: the maps of Argoverse 2 are JSON as well.
READERS = (
    womd_example.READER,
    womd_scenario.READER,
    argoverse2.READER,
    commonroad.READER,
    json_scenes.READER,
    scenarionet.READER,
    pufferdrive.READER,
)


def read(
    path: pathlib.Path, timeline: Timeline = timelines.DEFAULT
) -> Iterator[Scenario | BadRecord]:
    """Yields the scenarios of a file, and each record of it that cannot be used.

    The format is told from the content, plain or gzip. Whatever a file contains,
    reading it raises nothing; memory does not grow with the number of records.

    Args:
        path: a file.
        timeline: how the steps of its logs become those of the simulator.

    Returns:
        One item for each record: a scenario that `scenario.check` has passed, or why
        there is none.

    Raises:
        FileNotFoundError: if there is no such file.
        IsADirectoryError: if the path is a folder.
        PermissionError: if the file may not be read.
    """
    _require_readable(path)
    try:
        head = base.head_of(path)
    except ScenarioError as error:
        return _bad_file(path, str(error))
    if not head:
        return _bad_file(path, "the file is empty; copy it again")
    for reader in READERS:
        if reader.recognizes(head):
            return _settled(reader.records(path), path, timeline)
    *names, last = (reader.name for reader in READERS)
    return _bad_file(
        path,
        f"no known format: the file begins with {head[:12]!r}; if it is meant to be "
        f"{', '.join(names)} or {last}, its beginning is damaged: copy it again",
    )


def _settled(
    records: Iterator[Scenario | BadRecord], path: pathlib.Path, timeline: Timeline
) -> Iterator[Scenario | BadRecord]:
    """Brings scenarios to the steps of the simulator and checks them."""
    for index, record in enumerate(records):
        if isinstance(record, BadRecord):
            yield record
            continue
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                yield scenario.check(timelines.aligned(record, timeline))
        except ScenarioError as error:
            yield BadRecord(path=path, record_index=index, reason=str(error))


def _require_readable(path: pathlib.Path) -> None:
    """Raises unless the path is that of a file that may be read."""
    if path.is_dir():
        raise IsADirectoryError(
            f"{path} is a folder; name the files in it, as in {path}/*"
        )
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}; check the path")
    if not os.access(path, os.R_OK):
        raise PermissionError(f"{path} may not be read; check its owner and mode")


def _bad_file(path: pathlib.Path, reason: str) -> Iterator[BadRecord]:
    return iter([BadRecord(path=path, record_index=0, reason=reason)])
