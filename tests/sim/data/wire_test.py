"""Tests of the parsing of protocol buffers."""

import numpy as np
import pytest

from drivetrain.sim.data import wire
from drivetrain.sim.scenario import ScenarioError
from tests.sim.data import protos

UNKNOWN_FIELD = protos.field(15, 7)
VALUES = np.random.default_rng(0).normal(size=(20, 3))


def decoded(messages: list[bytes]) -> np.ndarray:
    """Returns the points of some messages."""
    point = wire.columns("MapPoint", messages)
    return np.stack([point["x"], point["y"], point["z"]], axis=-1)


def test_points_of_the_common_layout_come_back() -> None:
    assert np.array_equal(decoded([protos.map_point(xyz) for xyz in VALUES]), VALUES)


def test_points_of_other_layouts_equal_those_of_the_common_one() -> None:
    backwards = [
        b"".join(protos.field(axis + 1, float(xyz[axis])) for axis in (2, 1, 0))
        for xyz in VALUES
    ]
    longer = [protos.map_point(xyz) + UNKNOWN_FIELD for xyz in VALUES]
    common = [protos.map_point(xyz) for xyz in VALUES]
    mixed = [*backwards, *longer, *common]
    assert np.array_equal(decoded(mixed), np.concatenate([VALUES] * 3))


def test_absent_fields_are_zero() -> None:
    assert np.array_equal(decoded([b"", protos.field(2, 5.0)]), [[0, 0, 0], [0, 5, 0]])


def test_no_messages_give_no_rows() -> None:
    assert decoded([]).shape == (0, 3)


def state_but_for_valid() -> bytes:
    """Returns an ObjectState without its last field."""
    fields = [(2, 1.0), (3, 2.0), (4, 3.0)]
    fields += [(number, np.float32(number)) for number in range(5, 11)]
    return b"".join(protos.field(number, value) for number, value in fields)


def test_a_bool_of_several_bytes_is_parsed_in_full() -> None:
    tails = [b"\x58\x01", b"\x58\x00", b"\x58\x80\x01", b"\x58\x05"]
    state = wire.columns("ObjectState", [state_but_for_valid() + t for t in tails])
    assert state["valid"].tolist() == [1, 0, 1, 1]
    assert state["velocity_y"].tolist() == [10.0] * 4


def test_a_bool_that_does_not_end_is_an_error() -> None:
    with pytest.raises(ScenarioError, match="59 bytes are no ObjectState message"):
        wire.columns("ObjectState", [state_but_for_valid() + b"\x58\x80"])


def test_a_damaged_point_is_an_error() -> None:
    with pytest.raises(ScenarioError, match="27 bytes are no MapPoint message"):
        decoded([b"\xff" * 27])


def test_packed_and_single_numbers_are_the_same_feature() -> None:
    values = np.arange(-5, 400)
    for encode, number, kind in (
        (protos.integers, 3, np.int64),
        (protos.floats, 2, np.float32),
    ):
        for is_packed in (True, False):
            feature = protos.field(number, encode(1, values.astype(kind), is_packed))
            found = wire.numbers(feature)
            assert found.dtype == kind
            assert np.array_equal(found, values)


def test_packed_and_single_floats_may_be_mixed() -> None:
    packed = protos.floats(1, np.array([1.0, 2.0]), is_packed=True)
    single = protos.floats(1, np.array([3.0]), is_packed=False)
    feature = protos.field(2, packed + single + packed)
    assert wire.numbers(feature).tolist() == [1, 2, 3, 1, 2]


def test_an_example_is_told_from_a_scenario() -> None:
    example = protos.example_proto("id", {"state/id": np.zeros(300)})
    assert wire.looks_like_example(example)
    assert wire.looks_like_example(example[:40])
    assert wire.looks_like_example(b"\xff" + example[1:])  # damaged, with a known key
    assert wire.looks_like_example(protos.example_proto("id", {}).replace(b"/", b"-"))
    packed_timestamps = protos.field(1, np.arange(91.0).tobytes())
    assert not wire.looks_like_example(packed_timestamps)
    assert not wire.looks_like_example(protos.field(1, 0.1) + protos.field(5, b"id"))
