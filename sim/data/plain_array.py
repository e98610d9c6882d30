"""Makes arrays of the shape, the dtype and the bytes that a pickle states for them."""

import dataclasses
import math
import re
from typing import Any

import numpy as np
from jaxtyping import Shaped

from ..scenario import ScenarioError

MAX_DIMENSIONS = 4
MAX_VALUES = 1 << 27
_NUMBERS = re.compile(r"b1|[iu][1248]|f[248]")
_TEXTS = re.compile(r"U[1-9]\d{0,3}")
_OBJECTS = ("O", "O4", "O8")
_ORDERS = {"<": "<", "|": "<", "=": "<", ">": ">"}
_LAST_CHARACTER = 0x10FFFF


@dataclasses.dataclass(eq=False)
class Array:
    """An array that a pickle has begun and whose content is still to come."""

    memo_index: int | None = None  # where the pickle remembers it


@dataclasses.dataclass(eq=False)
class Dtype:
    """A dtype as a pickle spells it."""

    code: str  # a kind and its number of bytes, or of characters
    order: str = "<"


def dtype(arguments: Any) -> Dtype:
    """Returns the dtype that `numpy.dtype(*arguments)` would name.

    Raises:
        ScenarioError: if its values are no numbers, booleans, texts or objects.
    """
    # Nothing is compared, hashed or shown before its type is known: a value nested
    # a million times would take the interpreter down.
    code = arguments[0] if type(arguments[0]) is str else "?"
    if not (code in _OBJECTS or _NUMBERS.fullmatch(code) or _TEXTS.fullmatch(code)):
        raise ScenarioError(
            f"the pickle has an array of dtype {code!r:.40}; numbers, booleans, texts "
            "and lists of objects are read"
        )
    return Dtype(code)


def set_order(found: Dtype, state: Any) -> None:
    """Adds the byte order of a dtype, which a pickle states after it.

    Raises:
        ScenarioError: if the dtype has parts, or an order that there is not.
    """
    _, order, subarray, names, fields = state[:5]
    is_known = type(order) is str and order in _ORDERS
    if not is_known or not (subarray is names is fields is None):
        raise ScenarioError("the pickle has a dtype of several fields, or of no order")
    found.order = _ORDERS[order]


def array(
    shape: Any, found: Any, is_fortran: bool, data: Any
) -> Shaped[np.ndarray, "..."] | list[Any]:
    """Returns the array of a shape whose values are given as bytes, without copying.

    An array of objects has its values in a list, and comes back as that list.

    Raises:
        ScenarioError: if shape, dtype and data contradict one another.
    """
    count = _num_values(shape)
    if not isinstance(found, Dtype):
        raise ScenarioError("the pickle has an array without a dtype")
    if found.code in _OBJECTS:
        if type(data) is not list or shape != (len(data),):
            raise ScenarioError(
                f"the pickle has an array of objects of the shape {shape}, whose "
                "values are no list of that length"
            )
        return data
    kind = np.dtype(found.order + found.code)
    if not isinstance(data, bytes) or len(data) != count * kind.itemsize:
        size = len(data) if isinstance(data, bytes) else "no"
        raise ScenarioError(
            f"the pickle has an array of the shape {shape} and dtype {kind.str}, which "
            f"are {count * kind.itemsize} bytes, with {size} bytes"
        )
    _require_values(data, kind)
    return np.frombuffer(data, kind).reshape(shape, order="F" if is_fortran else "C")


def scalar(found: Any, data: Any) -> bool | int | float | str:
    """Returns the one value that is given as bytes.

    Raises:
        ScenarioError: if dtype and data contradict each other.
    """
    values = array((1,), found, False, data)
    if isinstance(values, list):
        raise ScenarioError("the pickle has a NumPy scalar that is an object")
    return values[0].item()


def _num_values(shape: Any) -> int:
    """Returns how many values an array of a shape has."""
    if not isinstance(shape, tuple) or len(shape) > MAX_DIMENSIONS:
        raise ScenarioError(
            f"the pickle has an array whose shape is no tuple of up to "
            f"{MAX_DIMENSIONS} lengths"
        )
    if not all(type(length) is int and length >= 0 for length in shape):
        raise ScenarioError("the pickle has an array with a length that is no count")
    if math.prod(max(length, 1) for length in shape) > MAX_VALUES:
        raise ScenarioError(
            f"the pickle has an array of the shape {shape}; at most {MAX_VALUES} "
            "values are read"
        )
    return math.prod(shape)


def _require_values(data: bytes, kind: np.dtype) -> None:
    """Checks bytes of which some stand for no value: NumPy would not."""
    limit = {"b": 1, "U": _LAST_CHARACTER}.get(kind.kind)
    if limit is None or not data:
        return
    unit = "u1" if kind.kind == "b" else kind.str[0] + "u4"
    largest = np.frombuffer(data, unit).max()
    if largest > limit:
        raise ScenarioError(
            f"the pickle has an array of dtype {kind.str} with {largest}, which is no "
            "such value"
        )
