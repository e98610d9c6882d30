"""Adds up what the pages of a parquet file unfold to, before anything unfolds them.

A page is compressed: half a megabyte of a hostile file unfolds to two gigabytes, and
the sizes in the footer may lie. Those before each page may not: what unfolds to more is
an error of its own. They are written in Thrift's compact protocol
(https://github.com/apache/thrift, doc/specs/thrift-compact-protocol.md); the numbers of
fields are those of https://github.com/apache/parquet-format, parquet.thrift.
"""

from typing import Any

from ..scenario import ScenarioError

MAX_PAGES = 20_000
_MAX_DEPTH = 32
_FOOTER_END = 8  # bytes: the length of the footer, and the magic

# Of FileMetaData, RowGroup, ColumnChunk, ColumnMetaData and PageHeader.
_ROW_GROUPS, _COLUMNS, _META_DATA = 4, 1, 3
_COMPRESSED, _DATA_OFFSET, _DICTIONARY_OFFSET = 7, 9, 11
_PAGE_UNFOLDED, _PAGE_COMPRESSED = 2, 3

# Of the protocol.
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET = range(1, 11)
_STRUCT = 12


def unfolded_bytes(record: bytes, limit: int) -> int:
    """Returns how many bytes all pages of a file unfold to.

    Args:
        record: the file.
        limit: beyond which counting ends with an error.

    Raises:
        ScenarioError: if the file is damaged, or unfolds to more than the limit.
    """
    try:
        start = len(record) - _FOOTER_END
        length = int.from_bytes(record[start : start + 4], "little")
        footer, _ = _struct(record, start - length, 0)
        return sum(
            _chunk_bytes(record, column[_META_DATA], limit)
            for group in footer[_ROW_GROUPS]
            for column in group[_COLUMNS]
        )
    except (IndexError, KeyError, TypeError, AttributeError) as error:
        raise ScenarioError(
            "the parquet data are damaged (their footer or a page's head is cut); copy "
            "the file again"
        ) from error


def _chunk_bytes(record: bytes, column: dict[int, Any], limit: int) -> int:
    """Returns what the pages of one column of one group of rows unfold to."""
    at = column[_DATA_OFFSET]
    if 0 < column.get(_DICTIONARY_OFFSET, 0) < at:
        at = column[_DICTIONARY_OFFSET]
    end = min(at + column[_COMPRESSED], len(record))
    num_pages = num_bytes = 0
    while at < end:
        head, at = _struct(record, at, 0)
        unfolded, compressed = head[_PAGE_UNFOLDED], head[_PAGE_COMPRESSED]
        num_pages, num_bytes = num_pages + 1, num_bytes + unfolded
        if unfolded < 0 or compressed < 0 or num_pages > MAX_PAGES:
            raise ScenarioError("the parquet data are damaged: a page has no size")
        if num_bytes > limit:
            raise ScenarioError(f"a parquet column unfolds to more than {limit} bytes")
        at += compressed
    return num_bytes


def _struct(record: bytes, at: int, depth: int) -> tuple[dict[int, Any], int]:
    """Returns the fields of a struct by number, and where it ends."""
    if at < 0 or depth > _MAX_DEPTH:
        raise IndexError(at)
    fields, field = {}, 0
    while (head := record[at]) != 0:
        at += 1
        if head >> 4:
            field += head >> 4
        else:
            field, at = _integer(record, at)
        kind = head & 15
        if kind in (_TRUE, _FALSE):
            fields[field] = kind == _TRUE
        else:
            fields[field], at = _value(record, at, kind, depth)
    return fields, at + 1


def _value(record: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """Returns a value of one kind, None for those that nothing asks for."""
    if kind in (_I16, _I32, _I64):
        return _integer(record, at)
    if kind == _STRUCT:
        return _struct(record, at, depth + 1)
    if kind in (_LIST, _SET):
        return _list(record, at, depth)
    if kind == _BINARY:
        length, at = _varint(record, at)
        return None, at + length
    if kind in (_TRUE, _FALSE, _BYTE):
        return None, at + 1
    if kind == _DOUBLE:
        return None, at + 8
    raise IndexError(at)  # maps: parquet has none


def _list(record: bytes, at: int, depth: int) -> tuple[list[Any], int]:
    if depth > _MAX_DEPTH:
        raise IndexError(at)
    length, kind = record[at] >> 4, record[at] & 15
    at += 1
    if length == 15:
        length, at = _varint(record, at)
    values = []
    for _ in range(length):
        if at >= len(record):  # a length that lies ends where the record does
            raise IndexError(at)
        value, at = _value(record, at, kind, depth + 1)
        values.append(value)
    return values, at


def _integer(record: bytes, at: int) -> tuple[int, int]:
    value, at = _varint(record, at)
    return (value >> 1) ^ -(value & 1), at


def _varint(record: bytes, at: int) -> tuple[int, int]:
    value = 0
    for i in range(10):
        byte = record[at + i]
        value |= (byte & 127) << (7 * i)
        if byte < 128:
            return value, at + i + 1
    raise IndexError(at)
