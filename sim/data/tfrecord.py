"""Splits a TFRecord file into the payloads of its records, checking every checksum.

Framing (`tensorflow/core/lib/io/record_writer.h` states it): length as 8 bytes, masked
CRC-32C of these, the payload, masked CRC-32C of it; all numbers little-endian.
"""

import pathlib
import struct
from collections.abc import Callable, Iterator

import google_crc32c

from ..scenario import Scenario, ScenarioError
from . import base
from .base import BadRecord

# Ten times the largest record seen. Beyond, a length lies, or messages without content
# ask for a hundred times as much memory as they have bytes.
MAX_PAYLOAD_BYTES = 1 << 24
_HEADER = struct.Struct("<QI")
_FOOTER = struct.Struct("<I")


def masked_crc(data: bytes) -> int:
    """Returns the checksum as TFRecord stores it: CRC-32C, rotated and shifted."""
    crc = google_crc32c.value(data)
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def first_payload(head: bytes) -> bytes | None:
    """Returns the payload that a TFRecord begins with, as far as the head shows it.

    None if the head is not that of a TFRecord.
    """
    if len(head) < _HEADER.size or _HEADER.unpack_from(head)[1] != masked_crc(head[:8]):
        return None
    return head[_HEADER.size :]


def payloads(path: pathlib.Path) -> Iterator[bytes | BadRecord]:
    """Yields the payload of each record, or why there is none.

    After a payload with a wrong checksum reading goes on with the next record. A
    damaged length, or an early end of the file, ends the reading.
    """
    record_index = 0
    with base.opened(path) as stream:
        while True:
            try:
                header = base.take(stream, _HEADER.size)
                if not header:
                    return
                num_bytes = _length(header) + _FOOTER.size
                body = base.take(stream, num_bytes)
                if len(body) < num_bytes:
                    raise ScenarioError(
                        f"the file is cut off: {num_bytes} bytes were to follow, but "
                        f"{len(body)} do; copy the file again"
                    )
            except ScenarioError as error:
                yield BadRecord(path=path, record_index=record_index, reason=str(error))
                return
            yield _checked(body, path, record_index)
            record_index += 1


def scenarios(
    path: pathlib.Path, convert: Callable[[bytes], Scenario]
) -> Iterator[Scenario | BadRecord]:
    """Yields what `convert` makes of the payload of each record."""
    for record_index, payload in enumerate(payloads(path)):
        if isinstance(payload, BadRecord):
            yield payload
        else:
            yield base.outcome(convert, payload, path, record_index)


def _length(header: bytes) -> int:
    """Returns the length of the payload that a whole and undamaged header announces."""
    if len(header) < _HEADER.size:
        raise ScenarioError(
            f"the file is cut off: it ends after {len(header)} of the {_HEADER.size} "
            "bytes of a record's header; copy the file again"
        )
    length, crc = _HEADER.unpack(header)
    if crc != masked_crc(header[:8]):
        raise ScenarioError(
            "the length of the record does not match its CRC-32C, so neither this "
            "record nor a later one can be found; copy the file again"
        )
    if length > MAX_PAYLOAD_BYTES:
        raise ScenarioError(
            f"the record claims {length} bytes, and at most {MAX_PAYLOAD_BYTES} "
            "are read; this is no file of scenarios"
        )
    return length


def _checked(body: bytes, path: pathlib.Path, record_index: int) -> bytes | BadRecord:
    """Splits the checksum from a payload and compares them."""
    payload, footer = body[: -_FOOTER.size], body[-_FOOTER.size :]
    if _FOOTER.unpack(footer)[0] == masked_crc(payload):
        return payload
    return BadRecord(
        path=path,
        record_index=record_index,
        reason=f"the payload of {len(payload)} bytes does not match its CRC-32C; copy "
        "the file again",
    )
