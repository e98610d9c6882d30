"""Loads scenarios, from a store, from files or from the generator, for a bank."""

import dataclasses
import hashlib
import pathlib
from collections.abc import Callable, Iterable
from typing import Any, Literal

import grain

from . import store
from .base import BadRecord
from .census import Census
from .entry import entry_of
from .inputs import all_records, inputs_of
from .pack import PackConfig
from .packed import Packed
from .query import EVERYTHING, Query

Split = Literal["all", "train", "test"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Source:
    """Which scenarios to load.

    `path` is a store, a file, a pattern of files, or `synthetic:FIRST:COUNT` for
    generated scenarios of the seeds FIRST to FIRST + COUNT - 1.
    """

    path: str
    split: Split = "all"  # by scenario id, so that adding files moves none
    query: Query = EVERYTHING
    test_share: float = 1 / 3  # of the scenarios, for the splits train and test
    max_scenarios: int | None = None
    quantize: bool = True  # of what is packed here; a store is as it was prepared

    @property
    def is_store(self) -> bool:
        """Whether the path is that of a folder, so of a store."""
        return pathlib.Path(self.path).is_dir()

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
    num_workers: int = 1,
) -> list[Packed]:
    """Returns the scenarios of a source.

    Args:
        source: what to load.
        tick: called after each scenario with their number so far.
        num_workers: processes that share the work on files and generated scenarios.

    Raises:
        FileNotFoundError: if there is no such store or file.
        SourceError: if it holds no usable scenario of the split.
        StoreError: if the store is damaged.
        ValueError: if `synthetic:FIRST:COUNT` is malformed.
    """
    _, loaded = load_share(source, range, tick, num_workers)
    return list(loaded.values())


def load_share(
    source: Source,
    share: Callable[[int], Iterable[int]],
    tick: Callable[[int], None] = lambda done: None,
    num_workers: int = 1,
) -> tuple[int, dict[int, Packed]]:
    """Returns how many scenarios a source has, and some of them by number.

    Of a store no others are read; of files and the generator all are, and the others
    dropped.

    Args:
        source: what to load.
        share: of how many scenarios there are, the numbers of those that are wanted.
        tick: called after each scenario with their number so far.
        num_workers: as for `load`, which raises the same.
    """
    if source.is_store:
        return _of_store(source, share, tick)
    bad: list[BadRecord] = []
    kept: list[Packed] = []
    census = Census(source.split, source.query)
    limit = source.max_scenarios
    config = PackConfig(quantize=source.quantize)
    records = all_records(inputs_of(source.path), config, num_workers)
    for done, record in enumerate(records, start=1):
        tick(done)
        if isinstance(record, BadRecord):
            bad.append(record)
        elif _is_wanted(record, source, census):
            kept.append(record)
        if limit is not None and len(kept) >= limit:
            break
    if not kept:
        raise SourceError(_none_wanted(source, census, bad))
    return len(kept), {number: kept[number] for number in share(len(kept))}


def _of_store(
    source: Source,
    share: Callable[[int], Iterable[int]],
    tick: Callable[[int], None],
) -> tuple[int, dict[int, Packed]]:
    wanted = wanted_numbers(source)
    if not wanted:
        raise SourceError(_none_wanted(source, Census(source.split, source.query), []))
    records: Any = store.Records(pathlib.Path(source.path))
    own = sorted(set(share(len(wanted))))
    numbers: Any = [wanted[number] for number in own]
    dataset = grain.MapDataset.source(numbers).map(records.__getitem__)
    kept = {}
    for number, packed in zip(own, dataset.to_iter_dataset(), strict=True):
        kept[number] = packed
        tick(len(kept))
    return len(wanted), kept


def _none_wanted(source: Source, census: Census, bad: list[BadRecord]) -> str:
    """Returns the sentence that says why no scenario of a source can be had."""
    if source.is_store:
        for entry in store.entries(pathlib.Path(source.path)):
            is_in_split = in_split(entry.scenario_id, source.split, source.test_share)
            census.admits(is_in_split, lambda entry=entry: entry)
    reasons = "; ".join(str(record) for record in bad[:3])
    found = [part for part in (census.sentence(), reasons) if part]
    return ": ".join([f"no usable scenario in '{source.path}'", *found]) + "."


def wanted_numbers(source: Source) -> list[int]:
    """Returns the numbers of the records of a store that a source wants.

    Raises:
        FileNotFoundError: if there is no finished store.
        StoreError: if the store is damaged.
    """
    return [
        number
        for number, entry in enumerate(store.entries(pathlib.Path(source.path)))
        if in_split(entry.scenario_id, source.split, source.test_share)
        and source.query.matches(entry)
    ][: source.max_scenarios]


def _is_wanted(packed: Packed, source: Source, census: Census) -> bool:
    is_in_split = in_split(packed.scenario_id, source.split, source.test_share)
    return census.admits(is_in_split, lambda: entry_of(packed))


def in_split(scenario_id: str, split: Split, test_share: float) -> bool:
    """Tells whether a scenario belongs to a split, by a hash of its id alone."""
    if split == "all":
        return True
    digest = hashlib.sha256(scenario_id.encode()).digest()
    is_test = int.from_bytes(digest[:8], "big") < test_share * 2**64
    return is_test == (split == "test")


def count(source: Source) -> int | None:
    """Returns how many scenarios `load` looks at; None for bare files.

    Raises:
        FileNotFoundError: if there is no such store.
        StoreError: if the store is damaged.
        ValueError: if `synthetic:FIRST:COUNT` is malformed.
    """
    if source.is_store:
        return len(wanted_numbers(source))
    items = inputs_of(source.path)
    if all(isinstance(item, range) for item in items):
        return sum(len(item) for item in items if isinstance(item, range))
    return None
