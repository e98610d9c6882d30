"""Spells the words of a command as the parser of options reads them."""

import itertools
from collections.abc import Sequence

BOOLEANS = ("true", "false")
# Options of `train` that the next word belongs to.
WITH_VALUE = ("--out", "--processes", "--devices-per-process", "--restarts")


def spelt(words: Sequence[str]) -> list[str]:
    """Spells words as the parser has them.

    Booleans of queries are as in YAML. Fields of a config may stand after options.
    """
    found: list[str] = []
    for before, word in itertools.pairwise(["", *words]):
        name, sign, value = word.partition("=")
        if before.startswith("--query.") and word in BOOLEANS:
            word = word.capitalize()
        elif name.startswith("--query.") and value in BOOLEANS:
            word = name + sign + value.capitalize()
        found.append(word)
    return _options_first(found) if found[:1] == ["train"] else found


def _options_first(words: list[str]) -> list[str]:
    """Moves the options of `train` before its config and fields."""
    options, others = [], []
    for before, word in itertools.pairwise(words):
        is_option = word.startswith("-") or before in WITH_VALUE
        (options if is_option else others).append(word)
    return [words[0], *options, *others]
