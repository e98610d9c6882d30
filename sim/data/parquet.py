"""Takes columns out of parquet files, which need pyarrow."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Int

from ..scenario import ScenarioError

MAGIC = b"PAR1"
MAX_ROWS = 10**6
MAX_COLUMN_BYTES = 1 << 28  # of one column, as its metadata tell before it is read
_MAX_METADATA = 1 << 20  # bytes of a text, and members of a list, in the metadata


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

    What a file says of its size is checked before a column is read, and texts stay
    numbers of a dictionary: a small file cannot ask for much memory.

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

    limits = {
        "thrift_string_size_limit": _MAX_METADATA,
        "thrift_container_size_limit": _MAX_METADATA,
        "page_checksum_verification": True,
    }
    file = pyarrow.parquet.ParquetFile(pyarrow.BufferReader(record), **limits)
    known = file.schema.names
    missing = [name for name in names if known.count(name) != 1]
    if missing:
        raise ScenarioError(
            f"there is no column {missing[0]!r}: this is no motion forecasting scenario"
        )
    _check_size(file.metadata, names)
    file = pyarrow.parquet.ParquetFile(
        pyarrow.BufferReader(record),
        metadata=file.metadata,
        read_dictionary=texts,
        **limits,
    )
    table = file.read(columns=names, use_threads=False)
    for name in texts:
        kind = table.schema.field(name).type
        if not pyarrow.types.is_dictionary(kind) or kind.value_type != "string":
            raise ScenarioError(f"column {name!r} holds no texts")
    for name in names:
        if table.column(name).null_count:
            raise ScenarioError(f"column {name!r} has empty places")
    return table


def _check_size(metadata: Any, names: list[str]) -> None:
    """Raises ScenarioError for a file that holds too much, or nothing."""
    if not 0 < metadata.num_rows <= MAX_ROWS:
        raise ScenarioError(
            f"the parquet file has {metadata.num_rows} rows; 1 to {MAX_ROWS} are read"
        )
    size = dict.fromkeys(names, 0)
    num_rows = 0
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        num_rows += group.num_rows
        for column in map(group.column, range(group.num_columns)):
            if column.path_in_schema in size:
                size[column.path_in_schema] += column.total_uncompressed_size
                if column.num_values != group.num_rows:
                    raise ScenarioError(
                        f"column {column.path_in_schema!r} has {column.num_values} "
                        f"values in {group.num_rows} rows"
                    )
    if num_rows != metadata.num_rows:
        raise ScenarioError(
            f"the parquet file tells of {metadata.num_rows} rows but holds {num_rows}"
        )
    for name, num_bytes in size.items():
        if not 0 <= num_bytes <= MAX_COLUMN_BYTES:
            raise ScenarioError(f"column {name!r} is of {num_bytes} bytes")


def _texts(column: Any) -> Texts:
    """Returns a column of texts as codes, numbered as the texts first come."""
    coded = column.unify_dictionaries().combine_chunks()
    indices = coded.indices.to_numpy().astype(np.int64)
    used, first, codes = np.unique(indices, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)
    values = coded.dictionary.to_pylist()
    return Texts(codes=rank[codes], values=[values[i] for i in used[order].tolist()])
