"""Spells the words of a command as the parser of options reads them."""

import itertools
from collections.abc import Sequence

BOOLEANS = ("true", "false")


def spelt(words: Sequence[str]) -> list[str]:
    """Spells the booleans of queries, which are as in YAML, as tyro has them."""
    found: list[str] = []
    for before, word in itertools.pairwise(["", *words]):
        name, sign, value = word.partition("=")
        if before.startswith("--query.") and word in BOOLEANS:
            word = word.capitalize()
        elif name.startswith("--query.") and value in BOOLEANS:
            word = name + sign + value.capitalize()
        found.append(word)
    return found
