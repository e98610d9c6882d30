"""Damages files and documents in the ways in which they break or are broken."""

import copy
import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

ABSURD = (
    *(None, True, -1, 2**31, 2**62, 1e308, 0.5, math.nan, math.inf, "", "x", b"x"),
    *([], {}, (), [[1]], [[1.0], [1.0, 2.0]], ["x"] * 3, {"x": None}, [None]),
)
ABSURD_ARRAYS = (
    *(np.zeros(0), np.zeros((0, 3)), np.zeros((2, 2, 2)), np.array(7.0)),
    *(np.full(13, np.nan), np.full((13, 3), 1e300), np.array(["x"] * 13)),
    *(np.array([2**62] * 13), np.zeros((13, 3), np.float16), np.full((13, 1), -1)),
)
NUMBERS = (
    *(b"\xff" * 8, b"\x00" * 8, b"9" * 8, b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff"),
    *(struct.pack("<d", math.nan), struct.pack("<f", math.nan), b"NaN", b"1e999"),
    *(struct.pack("<d", 1e300), struct.pack("<f", math.inf), struct.pack("<q", 2**62)),
    *(struct.pack("<i", 1_000_000), struct.pack("<H", 2**15), b"-", b"\x80" * 10),
)
OPENINGS = (b"[", b"{", b"(", b'{"a":', b"]", b"\x85", b"<a>", b"\x0a\x7f", b"\x0b")
MOST_OPENINGS = 20_000

Damage = Callable[[bytearray, np.random.Generator], None]


def place(data: bytearray, rng: np.random.Generator) -> int:
    """Returns a place in the data, half of the time near the beginning."""
    end = min(len(data), 64) if rng.random() < 0.5 else len(data)
    return int(rng.integers(end)) if end else 0


def flip(data: bytearray, rng: np.random.Generator) -> None:
    """Flips a few bits."""
    for at in rng.integers(len(data), size=rng.integers(1, 4)):
        data[at] ^= 1 << int(rng.integers(8))


def cut(data: bytearray, rng: np.random.Generator) -> None:
    """Cuts the end off, or a piece out."""
    at = place(data, rng)
    length = len(data) if rng.random() < 0.5 else int(rng.integers(1, 17))
    del data[at : at + length]


def repeat(data: bytearray, rng: np.random.Generator) -> None:
    """Inserts a slice of the data elsewhere."""
    at, length = place(data, rng), int(2 ** rng.uniform(0, math.log2(len(data) + 1)))
    data[at:at] = data[at // 2 : at // 2 + length]


def swap(data: bytearray, rng: np.random.Generator) -> None:
    """Swaps two words, as lengths may be taken for one another."""
    width = int(rng.choice([1, 4, 8]))
    a, b = place(data, rng) // width * width, place(data, rng) // width * width
    if abs(a - b) >= width and max(a, b) + width <= len(data):
        data[a : a + width], data[b : b + width] = (
            data[b : b + width],
            data[a : a + width],
        )


def overwrite(data: bytearray, rng: np.random.Generator) -> None:
    """Writes an absurd number over what is there."""
    at, number = place(data, rng), NUMBERS[int(rng.integers(len(NUMBERS)))]
    data[at : at + len(number)] = number


def overwrite_word(data: bytearray, rng: np.random.Generator) -> None:
    """Writes an absurd number where numbers of four bytes stand."""
    at = place(data, rng) // 4 * 4
    number = int(
        rng.choice([2**31 - 1, -1, 0, 1_000_000, 10_000, 255, 2**24, -(2**31)])
    )
    data[at : at + 4] = struct.pack("<i", number)


def nest(data: bytearray, rng: np.random.Generator) -> None:
    """Opens many containers."""
    at, opening = place(data, rng), OPENINGS[int(rng.integers(len(OPENINGS)))]
    data[at:at] = opening * int(2 ** rng.uniform(1, math.log2(MOST_OPENINGS)))


DAMAGES: tuple[Damage, ...] = (
    *(flip, cut, repeat, swap, overwrite, overwrite_word, nest),
)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Returns the data with one or two damages."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 3))):
        if changed:
            DAMAGES[int(rng.integers(len(DAMAGES)))](changed, rng)
    return bytes(changed)


def replaced(
    document: Any, rng: np.random.Generator, absurd: tuple[Any, ...] = ABSURD
) -> Any:
    """Returns a document with an absurd value, or none, in one or two places.

    The places are those to which random walks from the top come.
    """
    document = copy.deepcopy(document)
    for _ in range(int(rng.integers(1, 3))):
        part = document
        while part:
            places = list(part) if isinstance(part, dict) else range(len(part))
            at = places[int(rng.integers(len(places)))]
            below = part[at]
            if not isinstance(below, dict | list) or not below or rng.random() < 0.2:
                if isinstance(part, dict) and rng.random() < 0.2:
                    del part[at]
                else:
                    part[at] = copy.deepcopy(absurd[int(rng.integers(len(absurd)))])
                break
            part = below
    return document
