"""Names what scenarios are made of: files of logs, and seeds of the generator."""

import functools
import glob
import pathlib
from collections.abc import Iterator, Sequence

from ..scenario import ScenarioError
from . import build as readers, store, workers
from .base import BadRecord
from .pack import PackConfig, pack
from .packed import Packed
from .synthetic.generate import generate

SYNTHETIC = "synthetic:"
PIECE = 8  # seeds that a worker takes at a time
MANY_PIECES = 16  # from which workers save more time than they take to begin
Input = pathlib.Path | range  # a file, or seeds


def inputs_of(text: str) -> Sequence[Input]:
    """Returns the inputs that a text names: a file, a pattern, or generated scenarios.

    Raises:
        FileNotFoundError: if no file is so named.
        IsADirectoryError: if the text is that of a folder.
        ValueError: if `synthetic:FIRST:COUNT` is malformed.
    """
    if text.startswith(SYNTHETIC):
        return [synthetic_seeds(text)]
    return matching_files(text)


def packed_records(item: Input, config: PackConfig) -> Iterator[Packed | BadRecord]:
    """Yields the records of an input packed, or why they cannot be used.

    Raises:
        OSError: if the file cannot be opened.
    """
    if isinstance(item, range):
        yield from (pack(generate(seed), config) for seed in item)
        return
    for index, record in enumerate(readers.read(item, config.timeline)):
        if isinstance(record, BadRecord):
            yield record
            continue
        try:
            yield pack(record, config)
        except ScenarioError as error:
            yield BadRecord(path=item, record_index=index, reason=str(error))


def all_records(
    items: Sequence[Input], config: PackConfig, num_workers: int = 1
) -> Iterator[Packed | BadRecord]:
    """Yields the records of all inputs packed, in order.

    Args:
        items: the inputs.
        config: how scenarios are packed.
        num_workers: processes that share the work, where there is much of it.

    Raises:
        OSError: if a file cannot be opened.
        WorkerError: if a worker was killed.
    """
    pieces = [piece for item in items for piece in _pieces(item)]
    if num_workers < 2 or len(pieces) < MANY_PIECES:
        for piece in pieces:
            yield from packed_records(piece, config)
        return
    with workers.pool(min(num_workers, len(pieces))) as pool:
        for found in pool.map(functools.partial(_listed, config=config), pieces):
            yield from found


def _pieces(item: Input) -> Iterator[Input]:
    if isinstance(item, range):
        yield from (item[i : i + PIECE] for i in range(0, len(item), PIECE))
    else:
        yield item


def _listed(item: Input, config: PackConfig) -> list[Packed | BadRecord]:
    return list(packed_records(item, config))


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
        IsADirectoryError: if it is a folder.
    """
    paths = [pathlib.Path(name) for name in sorted(glob.glob(pattern, recursive=True))]
    if pathlib.Path(pattern).is_file():
        paths = [pathlib.Path(pattern)]
    files = [path for path in paths if path.is_file()]
    folder = pathlib.Path(pattern)
    if not files and store.is_store(folder):
        raise IsADirectoryError(
            f"'{pattern}' is a store already; name the files that it was made of"
        )
    if not files and folder.is_dir():
        raise IsADirectoryError(
            f"'{pattern}' is a folder; give a quoted pattern of the files in it, such "
            f"as '{folder / '*'}'"
        )
    if not files:
        raise FileNotFoundError(
            f"no file matches '{pattern}'; name a store made by 'drivetrain prepare', "
            "a file, a quoted pattern of files, or synthetic:FIRST:COUNT"
        )
    return files
