"""Chooses the scenarios on which benchmarks run, and makes their banks."""

import dataclasses
import os
from collections.abc import Iterable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ...sim.data import bank as banks, loader
from ...sim.data.bank import Bank, Sizes
from ...sim.data.packed import Packed
from ...sim.env.base import State
from ..progress import progress


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Scenes:
    """Scenarios on the host, those with the most objects first."""

    scenarios: Sequence[Packed]

    def bank(self, num_objects: int) -> Bank:
        """Returns a bank on the default device with just so many object slots.

        Scenarios with more objects keep those that matter most to the ego; the slots
        of those with fewer stay empty, and cost the same.
        """
        sizes = Sizes.of(self.scenarios, num_objects)
        sizes = dataclasses.replace(sizes, num_objects=num_objects)
        return jax.device_put(banks.build(self.scenarios, sizes))

    def indices(self, batch: int, shift: int) -> Int[Array, " batch"]:
        """Returns the scenarios of a batch: all in turn, beginning anywhere."""
        return (shift + jnp.arange(batch)) % len(self.scenarios)


def load(data: str, count: int) -> Scenes:
    """Loads the scenarios of a source that have the most objects.

    Args:
        data: a store, a file, a pattern of files, or synthetic:FIRST:COUNT.
        count: how many to keep.

    Raises:
        FileNotFoundError: if there is no such store or file.
        ValueError: if there is no usable scenario.
    """
    source = loader.Source(path=data)
    with progress("loading", loader.count(source), unit="scenarios") as line:
        scenarios = loader.load(source, line.update, os.cpu_count() or 1)
    fullest = sorted(scenarios, key=lambda s: len(s.object_id), reverse=True)
    return Scenes(scenarios=fullest[:count])


def mean_valid(batches: Iterable[State]) -> float:
    """Returns how many objects are there in a world, on average over some batches."""
    counts = [jnp.sum(states.motion.valid, axis=-1) for states in batches]
    return float(jnp.mean(jnp.stack(counts)))
