"""Takes numbers out of parsed JSON; what is none is an error of types or values."""

import array
import itertools
import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
import orjson
from jaxtyping import Float, Int

from ..scenario import ScenarioError

# Ten times those of the largest file seen. A value of two bytes takes a hundred.
_MAX_VALUES = 1 << 21
_PLACES = ("x", "y", "z")


def document(text: bytes, what: str) -> Any:
    """Parses a text, unless it has more values than one of a scenario.

    Args:
        text: the JSON.
        what: how a sentence is to name it.

    Raises:
        ScenarioError: if there are too many values, or the text is no JSON.
    """
    num_values = sum(map(text.count, (b",", b"[", b"{")))
    if num_values > _MAX_VALUES:
        raise ScenarioError(
            f"{what} has about {num_values} values; this is no file of one scenario"
        )
    try:
        return orjson.loads(text)
    except orjson.JSONDecodeError as error:
        raise ScenarioError(
            f"{what} is no valid JSON ({error}); copy the file again"
        ) from error


# array.array takes numbers alone; NumPy would also take texts, nulls and ragged lists.


def integers(values: Iterable[Any]) -> Int[np.ndarray, " values"]:
    """Returns integers of 64 bits; anything else is an error of types or values."""
    return np.array(array.array("q", values), np.int64)


def floats(values: Iterable[Any]) -> Float[np.ndarray, " values"]:
    """Returns numbers in float64; anything else is an error of types or values."""
    return np.array(array.array("d", values), np.float64)


def vectors(records: Any, axes: tuple[str, ...]) -> Float[np.ndarray, "records 3"]:
    """Returns the named members of each record; z is 0 where it is not named."""
    flat = map(operator.itemgetter(*axes), records)
    found = floats(itertools.chain.from_iterable(flat))
    filled = np.zeros((len(records), 3))
    filled[:, : len(axes)] = found.reshape(-1, len(axes))
    return filled


def places(records: Any) -> Float[np.ndarray, "records 3"]:
    """Returns members x, y and z of each record; z is 0 where the first has none."""
    has_height = bool(records) and "z" in records[0]
    return vectors(records, _PLACES if has_height else _PLACES[:2])
