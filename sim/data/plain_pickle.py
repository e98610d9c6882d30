"""Reads pickles of plain data and NumPy arrays without running anything in them.

Work and memory are bounded: by the number of instructions, each of which costs little,
and by what the result would hold if nothing in it were shared.
"""

import re
import struct
from typing import Any

import numpy as np

from ..scenario import ScenarioError
from . import pickle_machine
from .pickle_machine import Machine

MAX_INSTRUCTIONS = 1 << 21  # ten times those of the richest file seen
MAX_SIZE = 1 << 26  # bytes of the data with everything that is shared written out
MAX_DEPTH = 64  # containers around one another
_LEAF_BYTES = 8
_CONTAINERS = frozenset((dict, list, tuple))
_SMALL = frozenset((float, int, bool, type(None)))

# The protocol, then what a dictionary or an object may begin with. Other formats have a
# number here that is below 65,536, and so a third byte that is zero.
_HEAD = re.compile(rb"\x80[\x02-\x05][\x95}(\]c\x8cN)]")


def looks_like_pickle(head: bytes) -> bool:
    """Whether a file begins as pickles of the protocols 2 to 5 do."""
    return bool(_HEAD.match(head))


def loads(data: bytes) -> Any:
    """Returns what a pickle holds.

    Dictionaries of any kind come back as `dict`, sets as lists, and so do arrays of
    objects. Other arrays are read-only.

    Args:
        data: the pickle, of a protocol from 2 to 5.

    Raises:
        ScenarioError: if the pickle is damaged, names what is no plain data, contains
            itself, or is larger than the limits above.
    """
    machine = Machine(data)
    try:
        result = _followed(machine)
    except (IndexError, KeyError, struct.error) as error:
        raise ScenarioError(
            f"the pickle is damaged near byte {machine.at}: it ends early, or uses "
            "what it has not made; copy the file again"
        ) from error
    except ScenarioError:
        raise
    except (TypeError, ValueError, AttributeError) as error:
        raise ScenarioError(
            f"the pickle is damaged near byte {machine.at}: {str(error)[:100]}; copy "
            "the file again"
        ) from error
    _require_bounded(result)
    return result


def _followed(machine: Machine) -> Any:
    """Follows the instructions up to the one that ends the pickle."""
    data, instructions = machine.data, pickle_machine.INSTRUCTIONS
    for _ in range(MAX_INSTRUCTIONS):
        opcode = data[machine.at]
        machine.at += 1
        if opcode in instructions:
            instructions[opcode](machine)
        elif opcode == pickle_machine.STOP:
            return machine.stack.pop()
        else:
            raise ScenarioError(
                f"the pickle has the instruction {bytes([opcode])!r} at byte "
                f"{machine.at - 1}, which plain data do not need; it is not followed"
            )
    raise ScenarioError(
        f"the pickle has more than {MAX_INSTRUCTIONS} instructions; this is no file of "
        "one scenario"
    )


def _require_bounded(result: Any) -> None:
    """Raises ScenarioError unless the data are plain, not too deep and not too large.

    What is shared counts each time that it appears, and is looked at once.
    """
    sizes: dict[int, int] = {}
    is_open: dict[int, None] = {}
    todo: list[tuple[Any, bool]] = [((result,), False)]
    while todo:
        node, is_done = todo.pop()
        if is_done:
            del is_open[id(node)]
            sizes[id(node)] = _size(node, sizes)
        elif id(node) not in sizes:
            inner = [
                (part, False) for part in _parts(node) if type(part) in _CONTAINERS
            ]
            if not inner:
                sizes[id(node)] = _size(node, sizes)
                continue
            if id(node) in is_open:
                raise ScenarioError("the pickle has a container that contains itself")
            is_open[id(node)] = None
            if len(is_open) > MAX_DEPTH:
                raise ScenarioError(
                    f"the pickle has more than {MAX_DEPTH} containers in one another; "
                    "this is no file of one scenario"
                )
            todo.append((node, True))
            todo += inner


def _parts(node: Any) -> Any:
    return node.values() if type(node) is dict else node


def _size(node: Any, sizes: dict[int, int]) -> int:
    """Returns how many bytes a container stands for, from those of its parts."""
    size = _LEAF_BYTES * len(node)
    for part in _parts(node):
        kind = type(part)
        if kind in _SMALL:
            continue
        if kind in _CONTAINERS:
            size += sizes[id(part)]
        elif kind is str or kind is bytes:
            size += len(part)
        elif kind is np.ndarray:
            size += part.nbytes
        else:
            raise ScenarioError(
                f"the pickle has a {kind.__name__} where data belong; it is no file of "
                "one scenario"
            )
    if size > MAX_SIZE:
        raise ScenarioError(
            f"the pickle unfolds to more than {MAX_SIZE} bytes; this is no file of one "
            "scenario"
        )
    return size
