"""Brings scenarios onto the devices, and says so."""

import dataclasses
import functools
import os
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from ..learners import mesh as meshes
from ..sim.data import bank as banks, dealing, loader
from ..sim.data.bank import Bank, Sizes
from ..sim.data.packed import Packed
from .progress import progress


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Loaded:
    """Scenarios on the devices, and what the host knows of them."""

    bank: Bank  # every leaf sharded along a leading axis of devices
    num_scenarios: int  # each counted once
    scenarios: Mapping[int, Packed]  # by number: all, or those of this process

    @property
    def num_devices(self) -> int:
        """How many devices, of all processes, share the bank."""
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

    Each process keeps those of its own devices.

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
    places = meshes.own_places(mesh)

    @functools.cache
    def own(count: int) -> list[list[int]]:
        dealt = deal(count, mesh.size)
        return [dealt[place] for place in places]

    def share(count: int) -> list[int]:
        return sorted({number for numbers in own(count) for number in numbers})

    with progress("loading", loader.count(source), unit="scenarios") as line:
        count, scenarios = loader.load_share(
            source, share, line.update, os.cpu_count() or 1
        )
    sizes = _agreed(banks.Sizes.of(list(scenarios.values()), max_objects))
    bank = dealing.build_shards(scenarios, sizes, own(count), meshes.largest)
    return Loaded(
        bank=meshes.shard(mesh, bank), num_scenarios=count, scenarios=scenarios
    )


def _agreed(sizes: Sizes) -> Sizes:
    """Returns sizes into which the scenarios of all processes fit."""
    own = dataclasses.asdict(sizes)
    most = meshes.largest(np.array(list(own.values())))
    return Sizes(**dict(zip(own, most.tolist(), strict=True)))


def describe(loaded: Loaded) -> str:
    """Returns a line about the bank: its scenarios, bytes, and what was left out."""
    num_bytes, count = banks.total_bytes(loaded.bank), loaded.num_scenarios
    held = int(jnp.sum(loaded.bank.num_scenarios))
    cap = loaded.bank.sizes.num_objects
    is_capped = np.zeros(count, np.int32)
    for number, scenario in loaded.scenarios.items():
        is_capped[number] = len(scenario.object_id) > cap
    capped = int(meshes.largest(is_capped).sum())
    line = (
        f"{count:,} scenarios on {loaded.num_devices} device(s), "
        f"{num_bytes / 1e6:,.1f} MB ({num_bytes / held / 1e3:,.1f} KB each)"
    )
    if held > count:
        line += f"; held {held / count:g} times, for as many in each of the strata"
    if capped:
        line += (
            f"; {capped} have more than {cap} objects, the least relevant are left out "
            "(max_objects)"
        )
    return line
