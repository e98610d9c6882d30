"""Says what the classes and functions that plain data name stand for: plain data.

Nothing is imported and nothing is called: a name is a text, with a meaning of ours.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

from ..scenario import ScenarioError
from . import plain_array
from .plain_array import Array

MAX_NAME = 200
_OBJECT_OF_METADRIVE = "metadrive.scenario.scenario_description."
_DICTIONARIES = ("collections.OrderedDict", "collections.defaultdict")
_SETS = ("builtins.set", "builtins.frozenset")
_FACTORIES = tuple(
    f"builtins.{name}" for name in "int long float bool str list dict".split()
)
_ARRAY_MODULES = ("numpy.core.", "numpy._core.")
_ARRAY_NAMES = ("multiarray._reconstruct", "multiarray.scalar", "numeric._frombuffer")
_KNOWN_NAMES = frozenset(
    [
        *(*_DICTIONARIES, *_SETS, *_FACTORIES),
        *("numpy.ndarray", "numpy.dtype", "_codecs.encode", "builtins.bytes"),
        *(module + name for module in _ARRAY_MODULES for name in _ARRAY_NAMES),
    ]
)


@dataclasses.dataclass(frozen=True)
class Name:
    """A class or function that a pickle names."""

    text: str  # with its module


def known(module: str, name: str) -> Name:
    """Returns a name that stands for plain data.

    Raises:
        ScenarioError: if it stands for anything else.
    """
    text = f"{module}.{name}".replace("__builtin__.", "builtins.")
    if text not in _KNOWN_NAMES and not text.startswith(_OBJECT_OF_METADRIVE):
        raise ScenarioError(
            f"the pickle names {text[:MAX_NAME]}, which is no plain data; it is not "
            "run. A file of scenarios has no need of it: do not trust where it is from"
        )
    return Name(text)


def made(name: str, arguments: Any, charge: Callable[[Any], None]) -> Any:
    """Returns what a function or class makes of arguments.

    Args:
        name: of the function or class, one of those that are known.
        arguments: in their order.
        charge: counts data that are about to be decoded.

    Raises:
        ScenarioError: if plain data are not written with such a call.
    """
    if name == "numpy.dtype":
        return plain_array.dtype(arguments)
    if name == "_codecs.encode" and type(arguments[0]) is str:
        charge(arguments[0])  # protocol 2 writes bytes so, and all as latin1
        return arguments[0].encode("latin1")
    if name == "builtins.bytes" and not arguments:
        return b""
    if name in _SETS and len(arguments) == 1 and type(arguments[0]) in (list, tuple):
        return arguments[0]
    is_object = name.startswith(_OBJECT_OF_METADRIVE) or name == _DICTIONARIES[0]
    if (is_object and not arguments) or (
        name == _DICTIONARIES[1] and all(type(factory) is Name for factory in arguments)
    ):
        return {}
    if name.endswith(_ARRAY_NAMES[0]):
        return Array()
    if name.endswith(_ARRAY_NAMES[1]):
        return plain_array.scalar(*arguments)
    if name.endswith(_ARRAY_NAMES[2]):
        data, found, shape, order = arguments
        charge(data)
        is_fortran = type(order) is str and order == "F"
        return plain_array.array(shape, found, is_fortran, data)
    raise ScenarioError(
        f"the pickle calls {name} in a way that plain data have no need of"
    )
