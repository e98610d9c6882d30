"""Follows the instructions of a pickle that plain data need, and refuses all others.

A pickle is a program for a small stack machine. `pickle_names` says what stands for the
classes and functions that it names: nothing is imported, nothing is called. Protocols 2
to 5, as `pickletools` of Python's library documents them.
"""

import dataclasses
import struct
from collections.abc import Callable
from typing import Any

from ..scenario import ScenarioError
from . import plain_array
from .pickle_names import MAX_NAME, Name, known, made
from .plain_array import Array, Dtype

MAX_DECODED = 1 << 27  # bytes of arrays and of texts turned into bytes, in all
MAX_INTEGER_BYTES = 8
STOP = ord(".")


@dataclasses.dataclass(eq=False)
class Machine:
    """What is left of a pickle to read, and what it has built so far."""

    data: bytes
    at: int = 0
    stack: list[Any] = dataclasses.field(default_factory=list)
    marks: list[int] = dataclasses.field(default_factory=list)
    memo: dict[int, Any] = dataclasses.field(default_factory=dict)
    num_decoded: int = 0  # bytes

    def take(self, num_bytes: int) -> bytes:
        """Returns the next bytes of the program."""
        end = self.at + num_bytes
        if end > len(self.data):
            raise ScenarioError(
                f"the pickle announces {num_bytes} bytes at byte {self.at}, but "
                f"{len(self.data) - self.at} follow; copy the file again"
            )
        taken = self.data[self.at : end]
        self.at = end
        return taken

    def since_mark(self) -> list[Any]:
        """Takes what lies on the stack above the last mark."""
        start = self.marks.pop()
        items = self.stack[start:]
        del self.stack[start:]
        return items

    def charge(self, data: Any) -> None:
        """Counts bytes to be decoded: a pickle may name the same ones many times."""
        self.num_decoded += len(data) if isinstance(data, bytes | str) else 0
        if self.num_decoded > MAX_DECODED:
            raise ScenarioError(
                f"the pickle has arrays of more than {MAX_DECODED} bytes in all; this "
                "is no file of one scenario"
            )


Instruction = Callable[[Machine], None]


def _number(layout: str) -> Instruction:
    """Returns the instruction that pushes a number of a fixed layout."""
    form = struct.Struct(layout)

    def push(machine: Machine) -> None:
        machine.stack += form.unpack_from(machine.data, machine.at)
        machine.at += form.size

    return push


def _long_integer(machine: Machine) -> None:
    (num_bytes,) = machine.take(1)
    if num_bytes > MAX_INTEGER_BYTES:
        raise ScenarioError(
            f"the pickle has an integer of {num_bytes} bytes; at most "
            f"{MAX_INTEGER_BYTES} are read"
        )
    machine.stack.append(int.from_bytes(machine.take(num_bytes), "little", signed=True))


def _run(layout: str, convert: Callable[[bytes], Any]) -> Instruction:
    """Returns the instruction that pushes bytes, before which their number stands."""
    form = struct.Struct(layout)

    def push(machine: Machine) -> None:
        (num_bytes,) = form.unpack_from(machine.data, machine.at)
        machine.at += form.size
        machine.stack.append(convert(machine.take(num_bytes)))

    return push


def _constant(value: Any) -> Instruction:
    return lambda machine: machine.stack.append(value)


def _empty(kind: type) -> Instruction:
    return lambda machine: machine.stack.append(kind())


def _tuple_of(count: int) -> Instruction:
    """Returns the instruction that makes a tuple of the last few values."""

    def push(machine: Machine) -> None:
        stack = machine.stack
        if len(stack) < count:
            raise IndexError
        stack[-count:] = [tuple(stack[-count:])]

    return push


def _tuple_since_mark(machine: Machine) -> None:
    machine.stack.append(tuple(machine.since_mark()))


def _list_since_mark(machine: Machine) -> None:
    machine.stack.append(machine.since_mark())


def _extend(machine: Machine, values: list[Any]) -> None:
    if type(machine.stack[-1]) is not list:
        raise TypeError("values are added to what is no list")
    machine.stack[-1].extend(values)


def _update(machine: Machine, items: list[Any]) -> None:
    target = machine.stack[-1]
    if type(target) is not dict or len(items) % 2:
        raise TypeError("items are added to what is no dictionary, or lack a value")
    keys = items[::2]
    # Hashes of texts cannot be foreseen and those of such integers hardly meet; tuples
    # and numbers of any length can be chosen to have one hash by the thousand.
    for key in keys:
        if type(key) is not str and type(key) is not int:
            raise TypeError(f"a dictionary has a key of type {type(key).__name__}")
    target.update(zip(keys, items[1::2], strict=True))


def _drop(machine: Machine) -> None:
    machine.stack.pop()


def _drop_since_mark(machine: Machine) -> None:
    machine.since_mark()


def _append(machine: Machine) -> None:
    value = machine.stack.pop()
    _extend(machine, [value])


def _set_item(machine: Machine) -> None:
    value, key = machine.stack.pop(), machine.stack.pop()
    _update(machine, [key, value])


def _remember(layout: str | None) -> Instruction:
    """Returns the instruction that remembers a value, at a number or the next one."""
    form = struct.Struct(layout or "<")

    def remember(machine: Machine) -> None:
        index = len(machine.memo)
        if layout is not None:
            (index,) = form.unpack_from(machine.data, machine.at)
            machine.at += form.size
        value = machine.stack[-1]
        if type(value) is Array:
            value.memo_index = index
        machine.memo[index] = value

    return remember


def _recall(layout: str) -> Instruction:
    """Returns the instruction that pushes what was remembered at a number."""
    form = struct.Struct(layout)

    def push(machine: Machine) -> None:
        (index,) = form.unpack_from(machine.data, machine.at)
        machine.at += form.size
        machine.stack.append(machine.memo[index])

    return push


def _protocol(machine: Machine) -> None:
    (protocol,) = machine.take(1)
    if not 2 <= protocol <= 5:
        raise ScenarioError(
            f"the pickle is of protocol {protocol}; protocols 2 to 5 are read"
        )


def _frame(machine: Machine) -> None:
    (num_bytes,) = struct.unpack_from("<Q", machine.data, machine.at)
    machine.at += 8
    if num_bytes > len(machine.data) - machine.at:
        raise ScenarioError(
            f"the pickle announces a frame of {num_bytes} bytes, but "
            f"{len(machine.data) - machine.at} follow; copy the file again"
        )


def _name_in_lines(machine: Machine) -> None:
    end = machine.data.index(b"\n", machine.at, machine.at + MAX_NAME)
    module = machine.take(end - machine.at)
    end = machine.data.index(b"\n", end + 1, end + 1 + MAX_NAME)
    name = machine.take(end - machine.at)[1:]
    machine.at += 1
    machine.stack.append(known(module.decode("ascii"), name.decode("ascii")))


def _name_on_stack(machine: Machine) -> None:
    name, module = machine.stack.pop(), machine.stack.pop()
    if type(module) is not str or type(name) is not str:
        raise TypeError("a name that is no text")
    machine.stack.append(known(module, name))


def _call(machine: Machine) -> None:
    """Makes what a known function would make."""
    arguments, function = machine.stack.pop(), machine.stack.pop()
    if type(function) is not Name or type(arguments) is not tuple:
        raise TypeError("a call of what is no function")
    machine.stack.append(made(function.text, arguments, machine.charge))


def _build(machine: Machine) -> None:
    """Gives an object its state: arrays their content, dtypes their order."""
    state = machine.stack.pop()
    target = machine.stack[-1]
    if type(target) is Dtype:
        plain_array.set_order(target, state)
    elif type(target) is Array:
        _, shape, found, is_fortran, data = state
        machine.charge(data)
        is_fortran = is_fortran is True
        machine.stack[-1] = plain_array.array(shape, found, is_fortran, data)
        if target.memo_index is not None:
            machine.memo[target.memo_index] = machine.stack[-1]
    elif type(target) is not dict:  # attributes of a kind of dictionary are left out
        raise TypeError("a state is given to what has none")


INSTRUCTIONS: dict[int, Instruction] = {
    ord(code): instruction
    for code, instruction in {
        "\x80": _protocol,
        "\x95": _frame,
        "(": lambda machine: machine.marks.append(len(machine.stack)),
        "0": _drop,
        "1": _drop_since_mark,
        "N": _constant(None),
        "\x88": _constant(True),
        "\x89": _constant(False),
        "J": _number("<i"),
        "K": _number("<B"),
        "M": _number("<H"),
        "G": _number(">d"),
        "\x8a": _long_integer,
        "C": _run("<B", bytes),
        "B": _run("<I", bytes),
        "\x8e": _run("<Q", bytes),
        "\x96": _run("<Q", bytes),
        "\x8c": _run("<B", bytes.decode),
        "X": _run("<I", bytes.decode),
        "\x8d": _run("<Q", bytes.decode),
        ")": _constant(()),
        "t": _tuple_since_mark,
        "\x85": _tuple_of(1),
        "\x86": _tuple_of(2),
        "\x87": _tuple_of(3),
        "]": _empty(list),
        "l": _list_since_mark,
        "\x8f": _empty(list),  # a set, whose order and uniqueness nobody needs
        "\x91": _list_since_mark,  # a frozen set
        "a": _append,
        "e": lambda machine: _extend(machine, machine.since_mark()),
        "\x90": lambda machine: _extend(machine, machine.since_mark()),
        "}": _empty(dict),
        "s": _set_item,
        "u": lambda machine: _update(machine, machine.since_mark()),
        "q": _remember("<B"),
        "r": _remember("<I"),
        "\x94": _remember(None),
        "h": _recall("<B"),
        "j": _recall("<I"),
        "c": _name_in_lines,
        "\x93": _name_on_stack,
        "R": _call,
        "\x81": _call,  # an object of a class, as dictionaries of MetaDrive are written
        "b": _build,
    }.items()
}
