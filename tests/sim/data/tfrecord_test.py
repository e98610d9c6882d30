"""Tests of the framing of TFRecords."""

import gzip
import pathlib
import struct

import pytest

from drivetrain.sim.data import base, tfrecord
from drivetrain.sim.data.base import BadRecord
from tests.sim.data import files

PAYLOADS = (b"first", b"", b"third" * 1000)


def read(folder: pathlib.Path, data: bytes) -> list[bytes | BadRecord]:
    """Writes a file and reads the payloads back."""
    path = folder / "log"
    path.write_bytes(data)
    return list(tfrecord.payloads(path))


def test_the_checksum_is_that_of_an_official_file() -> None:
    length = bytes.fromhex("b80c120000000000")  # how the tf.Example of WOMD begins
    stored = bytes.fromhex("2bf14f6b")
    assert struct.pack("<I", tfrecord.masked_crc(length)) == stored


def test_payloads_come_back(tmp_path: pathlib.Path) -> None:
    assert read(tmp_path, files.tfrecord(*PAYLOADS)) == [*PAYLOADS]


def test_a_gzip_file_reads_like_a_plain_one(tmp_path: pathlib.Path) -> None:
    assert read(tmp_path, gzip.compress(files.tfrecord(*PAYLOADS))) == [*PAYLOADS]


def test_a_length_that_looks_like_gzip_is_a_length(tmp_path: pathlib.Path) -> None:
    payload = bytes(0x088B1F)  # its length begins with the magic of gzip
    data = files.tfrecord(payload)
    assert data.startswith(b"\x1f\x8b\x08")
    assert read(tmp_path, data) == [payload]


def test_reading_goes_on_after_a_damaged_payload(tmp_path: pathlib.Path) -> None:
    data = bytearray(files.tfrecord(b"one", b"two", b"three"))
    data[len(files.frame(b"one")) + 12] ^= 1
    one, two, three = read(tmp_path, bytes(data))
    assert (one, three) == (b"one", b"three")
    assert isinstance(two, BadRecord)
    assert "record 1: the payload of 3 bytes does not match its CRC-32C" in str(two)


def test_a_damaged_length_ends_the_file(tmp_path: pathlib.Path) -> None:
    data = bytearray(files.tfrecord(b"one", b"two", b"three"))
    data[len(files.frame(b"one"))] ^= 1
    one, two = read(tmp_path, bytes(data))
    assert one == b"one"
    assert isinstance(two, BadRecord)
    assert "record 1: the length of the record does not match" in str(two)


@pytest.mark.parametrize("num_bytes", range(1, len(files.frame(b"two"))))
def test_a_cut_is_named(tmp_path: pathlib.Path, num_bytes: int) -> None:
    data = files.frame(b"one") + files.frame(b"two")[:num_bytes]
    one, two = read(tmp_path, data)
    assert one == b"one"
    assert isinstance(two, BadRecord)
    assert "record 1: the file is cut off" in str(two)


def test_an_absurd_length_is_not_believed(tmp_path: pathlib.Path) -> None:
    length = struct.pack("<Q", 2**62)
    (found,) = read(tmp_path, length + files.checksum(length) + b"data")
    assert isinstance(found, BadRecord)
    assert f"claims {2**62} bytes" in found.reason


def test_a_cut_gzip_file_yields_what_it_holds(tmp_path: pathlib.Path) -> None:
    data = gzip.compress(files.tfrecord(*PAYLOADS))
    *whole, last = read(tmp_path, data[:-4])
    assert whole == [*PAYLOADS]
    assert isinstance(last, BadRecord)
    assert "the gzip data are damaged or cut off" in last.reason


def test_an_open_file_holds_one_record_at_a_time(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(files.tfrecord(b"one") + b"garbage that no one has read yet")
    assert next(tfrecord.payloads(path)) == b"one"


def test_a_head_without_a_checksum_is_no_tfrecord() -> None:
    assert tfrecord.first_payload(b"") is None
    assert tfrecord.first_payload(bytes(base.HEAD_BYTES)) is None
    assert tfrecord.first_payload(files.frame(b"one"))[:3] == b"one"  # pyright: ignore
