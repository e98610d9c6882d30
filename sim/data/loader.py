"""Loads scenarios, from a store, from files or from the generator, for a bank."""

import dataclasses
import glob
import hashlib
import pathlib
from collections.abc import Callable, Iterator
from typing import Any, Literal

import grain

from ..scenario import ScenarioError
from . import build as readers, store
from .base import BadRecord
from .pack import PackConfig, Packed, pack
from .synthetic.generate import generate

Split = Literal["all", "train", "test"]
SYNTHETIC = "synthetic"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Source:
    """Which scenarios to load.

    `path` is a store, a file, a pattern of files, or `synthetic:FIRST:COUNT` for
    generated scenarios of the seeds FIRST to FIRST + COUNT - 1.
    """

    path: str
    split: Split = "all"  # by scenario id, so that adding files moves none
    test_share: float = 1 / 3  # of the scenarios, for the splits train and test
    max_scenarios: int | None = None
    quantize: bool = True  # of what is packed here; a store is as it was prepared

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if the share is no share, or no scenario is wanted.
        """
        if not 0 < self.test_share < 1:
            raise ValueError(
                f"test_share must be within 0 and 1, got {self.test_share}."
            )
        if self.max_scenarios is not None and self.max_scenarios < 1:
            raise ValueError(
                f"max_scenarios must be at least 1, got {self.max_scenarios}."
            )


class SourceError(ValueError):
    """A source without usable scenarios; the message says why and what would help."""


def load(
    source: Source,
    tick: Callable[[int], None] = lambda done: None,
) -> list[Packed]:
    """Returns the scenarios of a source.

    Args:
        source: what to load.
        tick: called after each scenario with their number so far.

    Raises:
        FileNotFoundError: if there is no such store or file.
        SourceError: if it holds no usable scenario of the split.
        StoreError: if the store is damaged.
        ValueError: if `synthetic:FIRST:COUNT` is malformed.
    """
    bad: list[BadRecord] = []
    kept: list[Packed] = []
    limit = source.max_scenarios
    for done, packed in enumerate(_open(source, bad), start=1):
        tick(done)
        if in_split(packed.scenario_id, source.split, source.test_share):
            kept.append(packed)
        if limit is not None and len(kept) >= limit:
            break
    if not kept:
        reasons = "; ".join(str(record) for record in bad[:3])
        raise SourceError(
            f"no usable scenario in '{source.path}' (split {source.split})"
            + (f": {reasons}" if reasons else ".")
        )
    return kept


def in_split(scenario_id: str, split: Split, test_share: float) -> bool:
    """Tells whether a scenario belongs to a split, by a hash of its id alone."""
    if split == "all":
        return True
    digest = hashlib.sha256(scenario_id.encode()).digest()
    is_test = int.from_bytes(digest[:8], "big") < test_share * 2**64
    return is_test == (split == "test")


def count(source: Source) -> int | None:
    """Returns how many scenarios a source has, of all splits; None for bare files.

    Raises:
        FileNotFoundError: if there is no such store.
        StoreError: if the store is damaged.
        ValueError: if `synthetic:FIRST:COUNT` is malformed.
    """
    if source.path.startswith(f"{SYNTHETIC}:"):
        return len(synthetic_seeds(source.path))
    path = pathlib.Path(source.path)
    return len(store.Records(path)) if path.is_dir() else None


def _open(source: Source, bad: list[BadRecord]) -> Iterator[Packed]:
    """Returns scenarios; bad records join the list on the way."""
    path = pathlib.Path(source.path)
    config = PackConfig(quantize=source.quantize)
    if source.path.startswith(f"{SYNTHETIC}:"):
        seeds = synthetic_seeds(source.path)
        return (pack(generate(seed), config) for seed in seeds)
    if path.is_dir():
        records: Any = store.Records(path)
        return iter(grain.MapDataset.source(records).to_iter_dataset())
    return _read_files(matching_files(source.path), config, bad)


def _read_files(
    files: list[pathlib.Path], config: PackConfig, bad: list[BadRecord]
) -> Iterator[Packed]:
    for path in files:
        for record in packed_records(path, config):
            if isinstance(record, BadRecord):
                bad.append(record)
            else:
                yield record


def packed_records(
    path: pathlib.Path, config: PackConfig
) -> Iterator[Packed | BadRecord]:
    """Yields the records of a file packed, or why they cannot be used.

    Raises:
        OSError: if the file cannot be opened.
    """
    for index, record in enumerate(readers.read(path)):
        if isinstance(record, BadRecord):
            yield record
            continue
        try:
            yield pack(record, config)
        except ScenarioError as error:
            yield BadRecord(path=path, record_index=index, reason=str(error))


def synthetic_seeds(text: str) -> range:
    """Returns the seeds of `synthetic:FIRST:COUNT`.

    Raises:
        ValueError: if it is malformed or the count is not positive.
    """
    parts = text.split(":")
    if len(parts) != 3 or not all(part.isdecimal() for part in parts[1:]):
        raise ValueError(
            f"'{text}' is no source: write synthetic:FIRST:COUNT with two whole "
            "numbers, for example synthetic:0:256."
        )
    first, count = int(parts[1]), int(parts[2])
    if count < 1:
        raise ValueError(f"'{text}' asks for no scenario: COUNT must be at least 1.")
    return range(first, first + count)


def matching_files(pattern: str) -> list[pathlib.Path]:
    """Returns the files of a name or pattern, sorted.

    Raises:
        FileNotFoundError: if there is none.
    """
    paths = [pathlib.Path(name) for name in sorted(glob.glob(pattern, recursive=True))]
    if pathlib.Path(pattern).is_file():
        paths = [pathlib.Path(pattern)]
    files = [path for path in paths if path.is_file()]
    if not files:
        raise FileNotFoundError(
            f"no file matches '{pattern}'; name a store made by 'drivetrain prepare', "
            "a file, a quoted pattern of files, or synthetic:FIRST:COUNT"
        )
    return files
