"""Tests of the reader of pickles that runs nothing."""

import collections
import pathlib
import pickle
import sys
import tracemalloc
import types
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from drivetrain.sim.data import plain_pickle
from drivetrain.sim.scenario import ScenarioError
from tests.sim.data import files, malice, pickles

PROTOCOLS = (2, 3, 4, 5)
MOST_MEMORY = 1 << 20  # bytes: what type checks take; the index would make 32 GiB
REAL_FILES = sorted((files.REAL_DATA / "scenarionet").glob("*.pkl"))[::2]

ARRAYS = {
    "numbers": np.arange(6.0).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "half": np.array([1.5], np.float16),
    "integers": np.array([-1, 2**62]),
    "small": np.arange(200, dtype=np.uint8),
    "booleans": np.array([True, False]),
    "texts": np.array(["LANE", "ä", ""]),
    "swapped": np.arange(3, dtype=">f4"),
    "one": np.array(7, np.int16),
    "none": np.zeros((0, 3)),
}

plain_data = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.text()
    # A NaN is not what it is.
    | st.floats(allow_nan=False)
    | st.binary(),
    lambda inner: (
        st.lists(inner)
        | st.dictionaries(st.text() | st.integers(-(2**31), 2**31), inner)
        | st.tuples(inner, inner)
    ),
    max_leaves=20,
)


@settings(max_examples=60, deadline=None)
@given(data=plain_data, protocol=st.sampled_from(PROTOCOLS))
def test_plain_data_come_back(data: Any, protocol: int) -> None:
    assert plain_pickle.loads(pickle.dumps(data, protocol)) == data


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_arrays_come_back(protocol: int) -> None:
    found = plain_pickle.loads(pickle.dumps(ARRAYS, protocol))
    assert list(found) == list(ARRAYS)
    for name, wanted in ARRAYS.items():
        assert found[name].dtype == wanted.dtype
        assert found[name].shape == wanted.shape
        assert np.array_equal(found[name], wanted)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_shared_arrays_and_lists_come_back_wherever_they_are(protocol: int) -> None:
    array, shared = np.arange(3.0), [1, 2]
    data = {"a": [array, shared], "b": array, "c": (shared, array.dtype.name)}
    found = plain_pickle.loads(pickle.dumps(data, protocol))
    assert found["a"][0] is found["b"]
    assert np.array_equal(found["b"], array)
    assert found["c"] == ([1, 2], "float64")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_dictionaries_sets_scalars_and_objects_become_plain(protocol: int) -> None:
    counts = collections.defaultdict(int, {"a": 1})
    data = {
        "ordered": collections.OrderedDict(b=1, a=2),
        "counts": counts,
        "set": {"x"},
        "frozen": frozenset({7}),
        "number": np.float32(0.5),
        "flag": np.bool_(True),
        "objects": np.array([None, "LANE_STATE_GO", 4], object),
    }
    assert plain_pickle.loads(pickle.dumps(data, protocol)) == {
        "ordered": {"b": 1, "a": 2},
        "counts": {"a": 1},
        "set": ["x"],
        "frozen": [7],
        "number": 0.5,
        "flag": True,
        "objects": [None, "LANE_STATE_GO", 4],
    }


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_description_of_metadrive_becomes_a_dictionary(
    monkeypatch: pytest.MonkeyPatch, protocol: int
) -> None:
    module = types.ModuleType("metadrive.scenario.scenario_description")
    kind = type("ScenarioDescription", (dict,), {"__module__": module.__name__})
    monkeypatch.setattr(module, "ScenarioDescription", kind, raising=False)
    for name in ("metadrive", "metadrive.scenario", module.__name__):
        monkeypatch.setitem(sys.modules, name, module)
    described = kind(id="x", length=3)
    described.attribute = 1
    found = plain_pickle.loads(pickle.dumps([described], protocol))
    assert found == [{"id": "x", "length": 3}]
    assert type(found[0]) is dict


@pytest.mark.parametrize("name", malice.calls())
def test_what_names_code_is_refused_by_its_name(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ScenarioError, match="is no plain data; it is not run") as error:
        plain_pickle.loads(malice.calls()[name])
    assert f"names {name}," in str(error.value)
    assert "caught" not in capfd.readouterr().out


@pytest.mark.parametrize("name", malice.tricks() | malice.forbidden())
def test_what_is_no_plain_data_is_refused(name: str) -> None:
    with pytest.raises(ScenarioError, match="the pickle "):
        plain_pickle.loads((malice.tricks() | malice.forbidden())[name])


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("a frame", "announces a frame of 18446744073709551615 bytes"),
        ("a text", "announces 4294967295 bytes at byte 7, but 1 follow"),
        ("a long text", "announces 4611686018427387904 bytes"),
        ("a long integer", "an integer of 255 bytes; at most 8"),
        ("laughs", "unfolds to more than"),
        ("an array many times", "unfolds to more than"),
        ("a list in itself", "contains itself"),
        ("a dictionary in itself", "contains itself"),
        ("bytes decoded many times", "arrays of more than 134217728 bytes in all"),
    ],
)
def test_bombs_are_refused_for_what_they_do(name: str, sentence: str) -> None:
    with pytest.raises(ScenarioError, match=f"the pickle .*{sentence}"):
        plain_pickle.loads(malice.bombs()[name])


def test_an_index_of_the_memo_costs_no_memory() -> None:
    data = malice.bombs()["an index of the memo"]
    tracemalloc.start()
    assert plain_pickle.loads(data) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MOST_MEMORY


@pytest.mark.parametrize(
    ("limit", "value", "sentence"),
    [
        ("MAX_INSTRUCTIONS", 10, "more than 10 instructions"),
        ("MAX_SIZE", 100, "unfolds to more than 100 bytes"),
        ("MAX_DEPTH", 3, "more than 3 containers"),
    ],
)
def test_limits_are_named(
    monkeypatch: pytest.MonkeyPatch, limit: str, value: int, sentence: str
) -> None:
    data = pickle.dumps([[[["some text that is rather long"] * 4]]] * 3)
    assert plain_pickle.loads(data)
    monkeypatch.setattr(plain_pickle, limit, value)
    with pytest.raises(ScenarioError, match=sentence):
        plain_pickle.loads(data)


def test_every_cut_pickle_is_refused() -> None:
    data = pickle.dumps({"a": [1, 2.0, "x", None], "b": ARRAYS["numbers"]})
    for end in range(len(data)):
        with pytest.raises(ScenarioError, match="the pickle "):
            plain_pickle.loads(data[:end])


def same(found: Any, wanted: Any) -> bool:
    """Whether plain data are what `pickle` makes of them."""
    if isinstance(wanted, dict):
        return list(found) == list(wanted) and all(
            map(same, found.values(), wanted.values())
        )
    if isinstance(wanted, list | tuple):
        is_kind = type(found) is type(wanted) and len(found) == len(wanted)
        return is_kind and all(map(same, found, wanted))
    if isinstance(wanted, set):
        return set(found) == wanted
    if isinstance(wanted, np.ndarray):
        return found.dtype == wanted.dtype and np.array_equal(found, wanted)
    return bool(found == wanted)


@pytest.mark.skipif(not REAL_FILES, reason=files.NO_REAL_DATA)
@pytest.mark.filterwarnings("ignore:numpy.core")  # the name of before NumPy 2
@pytest.mark.parametrize("path", REAL_FILES, ids=lambda path: path.stem)
def test_real_pickles_hold_what_pickle_says(path: pathlib.Path) -> None:
    assert same(plain_pickle.loads(path.read_bytes()), pickles.trusted(path))
