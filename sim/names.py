"""Says what to do about a name that nobody has."""

import difflib
from collections.abc import Collection


def unknown(kind: str, name: str, known: Collection[str]) -> ValueError:
    """Makes the error for an unknown name, with the nearest known one and the list.

    Args:
        kind: what is named, such as `dynamics`.
        name: what was asked for.
        known: what there is.
    """
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else "."
    return ValueError(f"unknown {kind} '{name}'{hint} Known: {', '.join(known)}.")
