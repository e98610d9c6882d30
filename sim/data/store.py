"""Keeps packed scenarios on disk, in ArrayRecord shards.

A store is a folder with `manifest.json` and, per shard, `shard-00000.array_record` and
`shard-00000.json`. Everything is written under another name first and then renamed, so
a store that can be opened is whole.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import pathlib
from collections.abc import Iterable, Iterator
from typing import Any

import grain
import msgpack
import numpy as np
import orjson
from array_record.python import array_record_module  # pyright: ignore

from .. import files
from .entry import Entry
from .packed import Packed

FORMAT_VERSION = 4
MANIFEST = "manifest.json"
WRITER_OPTIONS = "group_size:1,zstd:3"
_DTYPES = "bool float32 float64 int8 int16 int32 int64 uint8 uint16 uint32".split()


class StoreError(ValueError):
    """A store that cannot be read; the message says why and what would help."""


def encode(packed: Packed) -> bytes:
    """Returns the bytes of a packed scenario: equal scenarios give equal bytes."""
    fields = {
        field.name: _encode_value(getattr(packed, field.name))
        for field in dataclasses.fields(Packed)
    }
    return msgpack.Packer().pack(fields)


def decode(record: bytes) -> Packed:
    """Returns the packed scenario of bytes that `encode` made.

    Raises:
        StoreError: if the bytes are something else.
    """
    try:
        fields = msgpack.unpackb(record)
        return Packed(**{name: _decode_value(fields[name]) for name in fields})
    except (ValueError, TypeError, LookupError, msgpack.UnpackException) as error:
        raise StoreError(
            f"a record is no packed scenario of this version ({error}); "
            "make the store anew with 'drivetrain prepare'"
        ) from error


def _encode_value(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    return [value.dtype.name, list(value.shape), np.ascontiguousarray(value).tobytes()]


def _decode_value(value: Any) -> Any:
    if not isinstance(value, list):
        return value
    dtype, shape, data = value
    if dtype not in _DTYPES:
        raise ValueError(f"'{dtype}' is no dtype of a packed scenario")
    return np.frombuffer(data, dtype).reshape(shape)


def write_json(path: pathlib.Path, value: Any) -> None:
    """Writes JSON so that the file is either whole or not there."""
    files.write_whole(path, orjson.dumps(value, option=orjson.OPT_INDENT_2))


def read_json(path: pathlib.Path) -> Any:
    """Returns what `write_json` wrote."""
    return orjson.loads(path.read_bytes())


def entries(path: pathlib.Path) -> list[Entry]:
    """Returns what the manifest says of each scenario of a store, in their order.

    Raises:
        FileNotFoundError: if there is no finished store.
        StoreError: if the store is damaged.
    """
    return [one for found in _listings(path) for one in found.entries]


def bad_records(path: pathlib.Path) -> list[dict[str, Any]]:
    """Returns the file, record and reason of each record that `prepare` left out.

    Raises:
        FileNotFoundError: if there is no finished store.
        StoreError: if the store is damaged.
    """
    return [record for found in _listings(path) for record in found.bad]


@dataclasses.dataclass(frozen=True)
class _Listing:
    """The list of a shard."""

    entries: list[Entry]
    bad: list[dict[str, Any]]


def _listings(path: pathlib.Path) -> Iterator[_Listing]:
    """Yields the lists of the shards, each that of the shard in the manifest."""
    for shard in read_manifest(path)["shards"]:
        file = (path / shard["name"]).with_suffix(".json")
        try:
            listing = read_json(file)
            digest = listing["sha256"]
            found = [Entry(**fields) for fields in listing["scenarios"]]
            bad = list(listing["bad"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StoreError(
                f"'{file}' is damaged or missing; delete it and run prepare again with "
                "the same files"
            ) from error
        if digest != shard["sha256"]:
            raise StoreError(
                f"'{file}' is the list of another shard than '{shard['name']}' in "
                f"'{path / MANIFEST}'; delete it and run prepare again with the same "
                "files"
            )
        yield _Listing(found, bad)


def write_shard(path: pathlib.Path, scenarios: Iterable[Packed]) -> str:
    """Writes a shard and returns the SHA-256 of its bytes."""
    partial = path.with_name(f"{path.name}.partial")
    writer = array_record_module.ArrayRecordWriter(str(partial), WRITER_OPTIONS)
    try:
        for packed in scenarios:
            writer.write(encode(packed))
        writer.close()
        digest = file_digest(partial)
        os.replace(partial, path)
    except BaseException:  # a keyboard interrupt too leaves nothing half-written
        if writer.is_open():
            writer.close()
        partial.unlink(missing_ok=True)
        raise
    return digest


def file_digest(path: pathlib.Path) -> str:
    """Returns the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def is_store(path: pathlib.Path) -> bool:
    """Tells whether a folder is a finished store."""
    return (path / MANIFEST).is_file()


def read_manifest(path: pathlib.Path) -> dict[str, Any]:
    """Returns the manifest of a store.

    Raises:
        FileNotFoundError: if the folder is not there or holds no finished store.
        StoreError: if it was made by another version, or a shard is gone.
    """
    if not path.exists():
        raise FileNotFoundError(
            f"no store at '{path}'; make one with 'drivetrain prepare FILES {path}'"
        )
    if path.is_file():
        raise FileNotFoundError(
            f"'{path}' is a file, and a store is a folder; make one of logs with "
            "'drivetrain prepare FILES STORE'"
        )
    if not is_store(path):
        if not any(path.glob("shard-*")):
            raise FileNotFoundError(
                f"'{path}' is a folder that holds no store; to read the files in it, "
                f"give a quoted pattern such as '{path}/*'"
            )
        raise FileNotFoundError(
            f"'{path}' holds no finished store: {MANIFEST} is missing; "
            f"run 'drivetrain prepare FILES {path}', which continues where it was"
        )
    try:
        manifest = json.loads((path / MANIFEST).read_text())
        version = manifest["format_version"]
        shards = manifest["shards"]
        names = [pathlib.PurePath(shard["name"]) for shard in shards]
        [shard["sha256"] for shard in shards]
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(
            f"'{path / MANIFEST}' is damaged: it is no list of shards in JSON; delete "
            "it and run prepare again with the same files"
        ) from error
    if version != FORMAT_VERSION:
        raise StoreError(
            f"the store '{path}' has format {version}, this version reads "
            f"{FORMAT_VERSION}; make it anew with 'drivetrain prepare'"
        )
    for name in names:
        if name.name != str(name) or not (path / name).is_file():
            raise StoreError(
                f"shard '{name}' of the store '{path}' is missing; "
                "run prepare again with the same files"
            )
    return manifest


def shard_paths(path: pathlib.Path) -> list[pathlib.Path]:
    """Returns the shards of a store, in order.

    Raises:
        FileNotFoundError: if there is no finished store.
        StoreError: if the store is damaged.
    """
    return [path / shard["name"] for shard in read_manifest(path)["shards"]]


class Records:
    """The records of a store, by number, for a random access loader.

    Each is checked against the lists: how many there are when the store is opened, and
    the id of each when it is read. `verify` reads every byte.
    """

    def __init__(self, path: pathlib.Path):
        """Opens a store.

        Raises:
            FileNotFoundError: if there is no finished store.
            StoreError: if the store is damaged.
        """
        self._path = path
        self._ids = [entry.scenario_id for entry in entries(path)]
        names = [str(shard) for shard in shard_paths(path)]
        with self._named():
            self._source: Any = grain.sources.ArrayRecordDataSource(names)
            length = len(self._source)
        if length != len(self._ids):
            raise self._strange(f"{length} records, {len(self._ids)} in the lists")

    def __len__(self) -> int:
        return len(self._ids)

    def __getitem__(self, number: int) -> Packed:
        with self._named():
            record = self._source[number]
        packed = decode(record)
        if packed.scenario_id != self._ids[number]:
            raise self._strange(
                f"record {number} is '{packed.scenario_id}', by the lists "
                f"'{self._ids[number]}'"
            )
        return packed

    def _strange(self, what: str) -> StoreError:
        return StoreError(
            f"{_damaged_shard(self._path)} of the store '{self._path}' is not the one "
            f"that was made ({what}); delete it and run prepare again with the same "
            "files"
        )

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except (RuntimeError, OSError) as error:
            raise StoreError(
                f"{_damaged_shard(self._path)} of the store '{self._path}' is damaged "
                f"({error}); delete it and run prepare again with the same files"
            ) from error


def verify(path: pathlib.Path) -> None:
    """Checks every byte of every shard against the SHA-256 in the manifest.

    Raises:
        FileNotFoundError: if there is no finished store.
        StoreError: if one is not what was written; the message names the first.
    """
    for shard in read_manifest(path)["shards"]:
        if file_digest(path / shard["name"]) != shard["sha256"]:
            raise StoreError(
                f"shard '{shard['name']}' of the store '{path}' is not the one that "
                "was made; delete it and run prepare again with the same files"
            )


def _damaged_shard(path: pathlib.Path) -> str:
    """Returns the name of the first shard that is not what was written."""
    for shard in read_manifest(path)["shards"]:
        if file_digest(path / shard["name"]) != shard["sha256"]:
            return f"shard '{shard['name']}'"
    return "a shard"


def read(path: pathlib.Path) -> Iterator[Packed]:
    """Yields the scenarios of a store in order.

    Raises:
        FileNotFoundError: if there is no finished store.
        StoreError: if the store is damaged.
    """
    records = Records(path)
    for number in range(len(records)):
        yield records[number]
