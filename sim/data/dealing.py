"""Deals scenarios out to shards, each the bank of a device."""

from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np

from .bank import Bank, Sizes, build
from .packed import Packed

EVENNESS = 8  # a stratum has so many scenarios at least, or all have as many


def once(num_scenarios: int, num_shards: int) -> list[list[int]]:
    """Deals each scenario once, to play them all: number j of shard d is j D + d.

    Args:
        num_scenarios: how many there are.
        num_shards: D.

    Returns:
        The numbers of the scenarios of each shard.

    Raises:
        ValueError: if there are fewer scenarios than shards.
    """
    if num_scenarios < num_shards:
        raise ValueError(
            f"{num_scenarios} scenarios cannot be shared by {num_shards} devices: "
            "use at least as many scenarios as devices."
        )
    return [
        list(range(shard, num_scenarios, num_shards)) for shard in range(num_shards)
    ]


def by_stratum(num_scenarios: int, num_shards: int, num_strata: int) -> list[list[int]]:
    """Deals scenarios out to strata, to draw from them whatever the shards are.

    Of L strata, number s has the scenarios s, s + L, and so on. Of D shards, number d
    has the L / D strata from number d L / D on, of each one scenario in turn: number q
    of the shard belongs to its stratum q modulo L / D. A list of few scenarios is gone
    through several times, so that each is drawn about as often as another even if the
    strata do not divide them.

    Args:
        num_scenarios: how many there are, at least one.
        num_shards: D.
        num_strata: L.

    Returns:
        The numbers of the scenarios of each shard.

    Raises:
        ValueError: if the shards do not divide the strata.
    """
    per_shard = strata_of_each(num_strata, num_shards)
    total = num_scenarios
    while total % num_strata and total < EVENNESS * num_strata:
        total += num_scenarios
    shards: list[list[int]] = [[] for _ in range(num_shards)]
    for number in range(total):
        shards[number % num_strata // per_shard].append(number % num_scenarios)
    return shards


def strata_of_each(num_strata: int, num_shards: int) -> int:
    """Returns how many strata a shard has.

    Raises:
        ValueError: if the shards do not divide the strata.
    """
    if num_strata % num_shards:
        raise ValueError(
            f"strata must be a multiple of the number of devices, got {num_strata} for "
            f"{num_shards}; set learner.strata."
        )
    return num_strata // num_shards


def build_shards(
    scenarios: Sequence[Packed] | Mapping[int, Packed],
    sizes: Sizes,
    dealt: Sequence[Sequence[int]],
    agree: Callable[[np.ndarray], np.ndarray] = lambda lengths: lengths,
) -> Bank:
    """Builds a bank of each shard: every array gets a leading axis of shards.

    Args:
        scenarios: those that are dealt, by number.
        sizes: into which they fit, but for capped objects.
        dealt: the numbers of those of each shard.
        agree: of the longest length of each array here, that in all processes.

    Raises:
        ValueError: if `build` does not like the scenarios of a shard.
    """
    shards = [build([scenarios[i] for i in numbers], sizes) for numbers in dealt]
    leaves = [jax.tree.leaves(shard) for shard in shards]
    longest = [max(map(_length, arrays)) for arrays in zip(*leaves, strict=True)]
    lengths = agree(np.array(longest)).tolist()
    stacked = [
        np.stack([_padded(array, length) for array in arrays])
        for arrays, length in zip(zip(*leaves, strict=True), lengths, strict=True)
    ]
    return jax.tree.unflatten(jax.tree.structure(shards[0]), stacked)


def _length(array: np.ndarray) -> int:
    return len(array) if array.ndim else 0


def _padded(array: np.ndarray, length: int) -> np.ndarray:
    if not array.ndim:
        return array
    return np.pad(array, [(0, length - len(array)), *[(0, 0)] * (array.ndim - 1)])
