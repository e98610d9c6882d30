"""Takes columns out of parquet files, which need pyarrow."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Int

from ..scenario import ScenarioError
from . import parquet_pages

MAGIC = b"PAR1"
MAX_ROWS = 10**6
MAX_COLUMN_BYTES = 1 << 26  # of the pages of a column in one group of rows
MAX_TABLE_BYTES = 1 << 28
_MAX_METADATA = 1 << 20  # bytes of a text, and members of a list, in the metadata
_MAX_FOOTER = 1 << 18  # bytes, of which pyarrow makes 300 each; real ones have 10 kB


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Texts:
    """A column of texts: each row has one of a few values."""

    codes: Int[np.ndarray, " rows"]
    values: list[str]  # in the order in which they first come


def columns(
    record: bytes,
    texts: Sequence[str],
    integers: Sequence[str],
    numbers: Sequence[str],
) -> dict[str, Any]:
    """Returns named columns: texts as `Texts`, the others as int64 and float64.

    What a file unfolds to is checked before a column is read, and texts stay numbers of
    a dictionary: a small file cannot ask for much memory.

    Raises:
        ScenarioError: if pyarrow is missing, or the file is damaged, too large, or
            lacks a column of this kind.
    """
    try:
        import pyarrow
    except ImportError as error:
        raise ScenarioError(
            "parquet files are read by pyarrow, which is not installed; "
            "pip install 'drivetrain[argoverse2]'"
        ) from error
    try:
        table = _table(record, [*texts, *integers, *numbers], list(texts))
        found: dict[str, Any] = {}
        for name in texts:
            found[name] = _texts(table.column(name))
        for names, kind in ((integers, pyarrow.int64()), (numbers, pyarrow.float64())):
            for name in names:
                found[name] = table.column(name).cast(kind).to_numpy()
        return found
    # UnicodeDecodeError, ArrowInvalid and others are ValueErrors.
    except (pyarrow.ArrowException, OSError, ValueError, TypeError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(
            f"the parquet data are damaged ({str(error)[:200]}); copy the file again"
        ) from error
    except MemoryError as error:
        raise ScenarioError("the parquet data ask for too much memory") from error


def _table(record: bytes, names: list[str], texts: list[str]) -> Any:
    """Reads columns of a file after its metadata have been checked."""
    import pyarrow
    import pyarrow.parquet

    num_bytes = int.from_bytes(record[-8:-4], "little")
    if num_bytes > _MAX_FOOTER:
        raise ScenarioError(
            f"the parquet data are damaged: a footer of {num_bytes} bytes, at most "
            f"{_MAX_FOOTER} are read; copy the file again"
        )
    limits = {
        "thrift_string_size_limit": _MAX_METADATA,
        "thrift_container_size_limit": _MAX_METADATA,
        "page_checksum_verification": True,
    }
    file = pyarrow.parquet.ParquetFile(pyarrow.BufferReader(record), **limits)
    # A name may stand for a column within another, and for two columns.
    paths = [file.schema.column(i).path for i in range(len(file.schema))]
    known = [path.partition(".")[0] for path in paths]
    missing = [n for n in names if n not in paths or known.count(n) != 1]
    if missing:
        raise ScenarioError(
            f"there is no column {missing[0]!r}: this is no motion forecasting scenario"
        )
    _check_rows(file.metadata)
    num_bytes = parquet_pages.unfolded_bytes(record, MAX_COLUMN_BYTES)
    if num_bytes > MAX_TABLE_BYTES:
        raise ScenarioError(f"the parquet data unfold to {num_bytes} bytes")
    file = pyarrow.parquet.ParquetFile(
        pyarrow.BufferReader(record),
        metadata=file.metadata,
        read_dictionary=texts,
        **limits,
    )
    table = file.read(columns=names, use_threads=False)
    table.validate(full=True)  # codes beyond the dictionary are not noticed before
    for name in texts:
        kind = table.schema.field(name).type
        if not pyarrow.types.is_dictionary(kind) or kind.value_type != "string":
            raise ScenarioError(f"column {name!r} holds no texts")
    for name in names:
        if table.column(name).null_count:
            raise ScenarioError(f"column {name!r} has empty places")
    return table


def _check_rows(metadata: Any) -> None:
    """Raises ScenarioError for a file of too many rows, or none.

    What the metadata say of a column is not asked for: where it is damaged, pyarrow 26
    ends the process, while reading the column raises an error.
    """
    if not 0 < metadata.num_rows <= MAX_ROWS:
        raise ScenarioError(
            f"the parquet file has {metadata.num_rows} rows; 1 to {MAX_ROWS} are read"
        )
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    num_rows = sum(group.num_rows for group in groups)
    if num_rows != metadata.num_rows or any(group.num_rows < 0 for group in groups):
        raise ScenarioError(
            f"the parquet file tells of {metadata.num_rows} rows but holds {num_rows}"
        )


def _texts(column: Any) -> Texts:
    """Returns a column of texts as codes, numbered as the texts first come."""
    coded = column.unify_dictionaries().combine_chunks()
    indices = coded.indices.to_numpy().astype(np.int64)
    used, first, codes = np.unique(indices, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    values = coded.dictionary.to_pylist()
    return Texts(codes=rank[codes], values=[values[i] for i in used[order].tolist()])
