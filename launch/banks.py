"""Brings scenarios onto the devices, and says so."""

import dataclasses
import os
from collections.abc import Callable, Sequence

import jax
from jax.sharding import Mesh

from ..learners import mesh as meshes
from ..sim.data import bank as banks, dealing, loader
from ..sim.data.bank import Bank
from ..sim.data.packed import Packed
from .progress import progress


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Loaded:
    """Scenarios on the devices, and what the host knows of them."""

    bank: Bank  # every leaf sharded along a leading axis of devices
    scenarios: Sequence[Packed]  # each once, as they were loaded

    @property
    def num_devices(self) -> int:
        """How many devices share the bank."""
        return self.bank.num_scenarios.size

    @property
    def one_shard(self) -> Bank:
        """The shapes of the bank of one device."""
        return one_shard(self.bank)


def one_shard(bank: Bank) -> Bank:
    """Returns the shapes of the bank of one device."""
    return jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), bank
    )


def load(
    source: loader.Source,
    max_objects: int,
    mesh: Mesh,
    deal: Callable[[int, int], list[list[int]]] = dealing.once,
) -> Loaded:
    """Loads scenarios into a bank over the devices of a mesh.

    Args:
        source: the scenarios.
        max_objects: of a scenario, those that matter most to the ego.
        mesh: the devices.
        deal: of the numbers of scenarios and devices, which scenarios each device gets.

    Raises:
        FileNotFoundError: if there is no such store or file.
        ValueError: if there is no usable scenario, or they cannot be so dealt.
    """
    if max_objects < 1:
        raise ValueError(f"max_objects must be at least 1, got {max_objects}.")
    with progress("loading", loader.count(source), unit="scenarios") as line:
        scenarios = loader.load(source, line.update, os.cpu_count() or 1)
    sizes = banks.Sizes.of(scenarios, max_objects)
    dealt = deal(len(scenarios), mesh.size)
    bank = banks.build_shards(scenarios, sizes, dealt)
    return Loaded(bank=meshes.shard(mesh, bank), scenarios=scenarios)


def describe(loaded: Loaded) -> str:
    """Returns a line about the bank: its scenarios, bytes, and what was left out."""
    num_bytes = banks.total_bytes(loaded.bank)
    count = len(loaded.scenarios)
    capped = sum(
        len(scenario.object_id) > loaded.bank.sizes.num_objects
        for scenario in loaded.scenarios
    )
    line = (
        f"{count:,} scenarios on {loaded.num_devices} device(s), "
        f"{num_bytes / 1e6:,.1f} MB ({num_bytes / count / 1e3:,.1f} KB each)"
    )
    if capped:
        line += (
            f"; {capped} have more than {loaded.bank.sizes.num_objects} objects, the "
            "least relevant are left out (max_objects)"
        )
    return line
