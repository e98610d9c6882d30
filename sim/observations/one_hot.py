"""Sorts codes, such as types of objects, into groups."""

from collections.abc import Collection, Iterable

import numpy as np
from jaxtyping import Float


def one_hot_rows(
    groups: Collection[Iterable[int]], num_codes: int
) -> Float[np.ndarray, "codes groups"]:
    """Returns the one-hot group of each code; all zero for codes of no group.

    Args:
        groups: the codes of each group.
        num_codes: codes run from 0 to one less.
    """
    rows = np.zeros((num_codes, len(groups)), np.float32)
    for number, codes in enumerate(groups):
        rows[list(codes), number] = 1
    return rows
