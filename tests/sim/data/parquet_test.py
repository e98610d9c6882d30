"""Tests of the columns of parquet files."""

import io
import tracemalloc
from typing import Any

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet as writer

from drivetrain.sim.data import parquet
from drivetrain.sim.scenario import ScenarioError


def encoded(table: dict[str, Any], **options: Any) -> bytes:
    """Returns a table as a file."""
    stream = io.BytesIO()
    writer.write_table(pyarrow.table(table), stream, **options)
    return stream.getvalue()


@pytest.mark.parametrize("options", [{}, {"use_dictionary": False}])
@pytest.mark.parametrize("rows_at_once", [1000, 2])
def test_columns_come_back(options: dict[str, Any], rows_at_once: int) -> None:
    table = {"t": ["b", "a", "b", "c"], "i": [3, 1, 2, 0], "x": [0.5, 1, 2, 3]}
    record = encoded(table, row_group_size=rows_at_once, **options)
    found = parquet.columns(record, ["t"], ["i"], ["x"])
    assert found["t"].values == ["b", "a", "c"]
    assert found["t"].codes.tolist() == [0, 1, 0, 2]
    assert (found["i"].dtype, found["i"].tolist()) == (np.int64, table["i"])
    assert (found["x"].dtype, found["x"].tolist()) == (np.float64, table["x"])


def test_texts_are_numbered_as_they_come_not_as_a_dictionary_has_them() -> None:
    words = pyarrow.DictionaryArray.from_arrays([3, 0, 2, 3], ["a", "b", "c", "d"])
    found = parquet.columns(encoded({"t": words}), ["t"], [], [])
    assert found["t"].values == ["d", "a", "c"]
    assert found["t"].codes.tolist() == [0, 1, 2, 0]


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"t": ["a"], "i": [1]}, "there is no column 'x'"),
        ({"i": [1], "x": [1.0]}, "there is no column 't'"),
        ({"t": ["a"], "i": [None], "x": [1.0]}, "column 'i' has empty places"),
        ({"t": ["a"], "i": [1.5], "x": [1.0]}, "the parquet data are damaged"),
        ({"t": ["a"], "i": [[1]], "x": [1.0]}, "there is no column 'i'"),
        ({"t": [7], "i": [1], "x": [1.0]}, "column 't' holds no texts"),
        ({"t": [b"\xff"], "i": [1], "x": [1.0]}, "column 't' holds no texts"),
        ({"t": [["a"]], "i": [1], "x": [1.0]}, "there is no column 't'"),
        ({"a": [{"t": "a"}], "i": [1], "x": [1.0]}, "there is no column 't'"),
        ({"t": ["a"], "i": [1], "x": [{"x": 1.0}]}, "there is no column 'x'"),
    ],
)
def test_a_wrong_column_is_named(table: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ScenarioError, match=sentence):
        parquet.columns(encoded(table), ["t"], ["i"], ["x"])


def test_a_table_without_rows_is_named() -> None:
    record = encoded({"i": np.zeros(0, np.int64)})
    with pytest.raises(ScenarioError, match="has 0 rows; 1 to"):
        parquet.columns(record, [], ["i"], [])


def test_a_table_of_too_many_rows_is_named() -> None:
    record = encoded({"i": np.zeros(parquet.MAX_ROWS + 1, np.int64)})
    with pytest.raises(ScenarioError, match="has 1000001 rows; 1 to 1000000 are read"):
        parquet.columns(record, [], ["i"], [])


def test_a_long_footer_is_refused_before_it_is_read() -> None:
    columns = {f"{i:0100}": [1] for i in range(1000)}  # each name comes a few times
    with pytest.raises(ScenarioError, match=r"a footer of \d+ bytes, at most 262144"):
        parquet.columns(encoded(columns), [], ["i"], [])


def test_a_long_text_that_comes_often_is_held_once() -> None:
    num_rows, text = 10**5, "x" * 10**5  # 10 GB if each row held its own
    words = pyarrow.array([text]).dictionary_encode().take(np.zeros(num_rows, np.int8))
    record = encoded({"t": words})
    before = pyarrow.total_allocated_bytes()
    tracemalloc.start()
    found = parquet.columns(record, ["t"], [], [])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found["t"].values == [text]
    assert peak < 10**7
    assert pyarrow.total_allocated_bytes() - before < 10**7


def test_a_damaged_footer_ends_in_columns_or_a_sentence() -> None:
    # Some of these files make pyarrow end the process when asked for their metadata.
    record = encoded({"t": ["a", "b"], "i": [1, 2], "x": [0.5, 1.5]})
    length = int.from_bytes(record[-8:-4], "little")
    for at in range(len(record) - 8 - length, len(record)):
        for bit in range(0, 8, 3):
            damaged = bytearray(record)
            damaged[at] ^= 1 << bit
            try:
                found = parquet.columns(bytes(damaged), ["t"], ["i"], ["x"])
            except ScenarioError:
                continue
            assert len(found["i"]) == len(found["x"]) == len(found["t"].codes)


def test_codes_that_no_dictionary_has_are_named() -> None:
    record = encoded({"t": ["a", "b", "c"] * 8}, compression="none")
    codes = sum(((i % 3) << (2 * i)) for i in range(24)).to_bytes(6, "little")
    assert record.count(codes) == 1
    beyond = record.replace(codes, b"\xff" * 6)
    with pytest.raises(ScenarioError, match="the parquet data are damaged"):
        parquet.columns(beyond, ["t"], [], [])


def test_a_page_that_unfolds_to_too_much_is_named() -> None:
    text = "x" * (parquet.MAX_COLUMN_BYTES + 1)
    record = encoded({"t": [text]}, compression="gzip", use_dictionary=False)
    assert len(record) < 10**6
    with pytest.raises(ScenarioError, match="a parquet column unfolds to more than"):
        parquet.columns(record, ["t"], [], [])
