"""States what a reader of logs is, and opens files for readers, gzip or plain."""

import contextlib
import dataclasses
import gzip
import io
import pathlib
import re
import zlib
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..scenario import Scenario, ScenarioError

HEAD_BYTES = 1 << 16
MAX_RECORD_BYTES = 1 << 27  # thirty times the largest file of one scenario seen

# The magic, the method, any flags and time, then a byte that gzip restricts: the length
# of a TFRecord can imitate the magic (559,903 does), but then its checksum tells.
_GZIP_HEAD = re.compile(rb"\x1f\x8b\x08.{5}[\x00\x02\x04]", re.DOTALL)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BadRecord:
    """A record that cannot be used, and why."""

    path: pathlib.Path
    record_index: int
    reason: str  # a sentence: what is wrong, where, and the cure

    def __str__(self) -> str:
        """Says where the record is and why it cannot be used."""
        return f"{self.path}, record {self.record_index}: {self.reason}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reader:
    """Reads the scenarios of one format.

    `recognizes(head)` tells from the first decompressed bytes of a file, never from its
    name, whether it has this format. `records(path)` yields one item for each record,
    in constant memory; it never raises for what a file contains. Its scenarios are as
    the file has them: `build.read` brings them to steps of 0.1 s and checks them.
    """

    name: str
    recognizes: Callable[[bytes], bool]
    records: Callable[[pathlib.Path], Iterator[Scenario | BadRecord]]


@contextlib.contextmanager
def opened(path: pathlib.Path) -> Iterator[io.BufferedIOBase]:
    """Opens a file as its decompressed bytes."""
    with path.open("rb") as stream:
        is_gzip = _GZIP_HEAD.match(stream.read(10))
        stream.seek(0)
        if is_gzip:
            with gzip.GzipFile(fileobj=stream) as unzipped:
                yield unzipped
        else:
            yield stream


def take(stream: io.BufferedIOBase, num_bytes: int) -> bytes:
    """Reads up to `num_bytes`; fewer come only at the end.

    Raises:
        ScenarioError: if the gzip data are damaged or cut off.
    """
    try:
        return stream.read(num_bytes)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise ScenarioError(
            f"the gzip data are damaged or cut off ({error}); copy the file again"
        ) from error


def head_of(path: pathlib.Path) -> bytes:
    """Returns the first decompressed bytes of a file.

    Raises:
        ScenarioError: if the gzip data are damaged or cut off.
    """
    with opened(path) as stream:
        return take(stream, HEAD_BYTES)


def whole(path: pathlib.Path) -> bytes:
    """Returns the decompressed bytes of a file that holds one scenario.

    Raises:
        ScenarioError: if the gzip data are damaged or cut off, or the file is longer
            than a scenario can be.
    """
    with opened(path) as stream:
        content = take(stream, MAX_RECORD_BYTES + 1)
    if len(content) > MAX_RECORD_BYTES:
        raise ScenarioError(
            f"the file is longer than {MAX_RECORD_BYTES} bytes; this is no file of one "
            "scenario"
        )
    return content


def only_record(
    path: pathlib.Path, convert: Callable[[bytes], Scenario]
) -> Iterator[Scenario | BadRecord]:
    """Yields what `convert` makes of a file that holds one scenario."""
    try:
        content = whole(path)
    except ScenarioError as error:
        yield BadRecord(path=path, record_index=0, reason=str(error))
        return
    yield outcome(convert, content, path, record_index=0)


@contextlib.contextmanager
def naming(place: str) -> Iterator[None]:
    """Turns what Python says of a malformed part into a sentence that names it.

    Raises:
        ScenarioError: in the place of a KeyError, TypeError, ValueError or
            OverflowError.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        kind = "lacks" if isinstance(error, KeyError) else "is malformed:"
        raise ScenarioError(f"{place} {kind} {str(error)[:200]}") from error


def outcome(
    convert: Callable[[Any], Scenario],
    record: Any,
    path: pathlib.Path,
    record_index: int,
) -> Scenario | BadRecord:
    """Converts one record; `build.read` checks what comes out."""
    try:
        # Damaged numbers overflow on their way to the check that names them.
        with np.errstate(over="ignore", invalid="ignore"):
            return convert(record)
    except ScenarioError as error:
        return BadRecord(path=path, record_index=record_index, reason=str(error))
