"""Takes numbers out of parsed JSON; what is none is an error of types or values."""

import array
import itertools
import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

_PLACES = ("x", "y", "z")


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
