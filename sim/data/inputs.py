"""Names what scenarios are made of: files of logs, and seeds of the generator."""

import glob
import pathlib
from collections.abc import Iterator, Sequence

from ..scenario import ScenarioError
from . import build as readers
from .base import BadRecord
from .pack import PackConfig, pack
from .packed import Packed
from .synthetic.generate import generate

SYNTHETIC = "synthetic:"
Input = pathlib.Path | range  # a file, or seeds


def inputs_of(text: str) -> Sequence[Input]:
    """Returns the inputs that a text names: a file, a pattern, or generated scenarios.

    Raises:
        FileNotFoundError: if no file is so named.
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
