"""Adds up what the shards of a store hold, without keeping what each scenario is."""

import dataclasses
import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import UInt64

from .packed import QUANTUM


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tally:
    """What one shard holds, or several: eight bytes a scenario, and the bad records."""

    num_bytes: int  # of all scenarios in the bank
    num_coarse: int  # wider than 655 m, so that places are kept to more than 1 cm
    num_index_dropped: int  # candidates that did not fit into the index of road edges,
    num_index_listed: int  # and that did
    datasets: Counter[str]
    route_sources: Counter[str]
    bad: list[dict[str, Any]]  # file, record and reason of each record left out
    id_hashes: UInt64[np.ndarray, " scenarios"]

    @property
    def num_scenarios(self) -> int:
        """How many scenarios there are."""
        return len(self.id_hashes)

    def repeated(self) -> UInt64[np.ndarray, " ids"]:
        """Returns the hashes of the ids that came more than once."""
        found, counts = np.unique(self.id_hashes, return_counts=True)
        return found[counts > 1]


def tally_of(listing: Mapping[str, Any]) -> Tally:
    """Adds up the list of a shard.

    Raises:
        LookupError: if the list lacks what a shard's list has, and likewise TypeError.
    """
    entries = listing["scenarios"]
    return Tally(
        num_bytes=sum(entry["num_bytes"] for entry in entries),
        num_coarse=sum(entry["quantum"] > QUANTUM for entry in entries),
        num_index_dropped=sum(entry["num_index_dropped"] for entry in entries),
        num_index_listed=sum(entry["rows"]["blocks"] for entry in entries),
        datasets=Counter(entry["dataset"] for entry in entries),
        route_sources=Counter(entry["route_source"] for entry in entries),
        bad=listing["bad"],
        id_hashes=hashes(entry["scenario_id"] for entry in entries),
    )


def total(tallies: Sequence[Tally]) -> Tally:
    """Adds up tallies, at least one."""
    return Tally(
        num_bytes=sum(one.num_bytes for one in tallies),
        num_coarse=sum(one.num_coarse for one in tallies),
        num_index_dropped=sum(one.num_index_dropped for one in tallies),
        num_index_listed=sum(one.num_index_listed for one in tallies),
        datasets=sum((one.datasets for one in tallies), Counter()),
        route_sources=sum((one.route_sources for one in tallies), Counter()),
        bad=[record for one in tallies for record in one.bad],
        id_hashes=np.concatenate([one.id_hashes for one in tallies]),
    )


def hashes(scenario_ids: Iterable[str]) -> UInt64[np.ndarray, " ids"]:
    """Returns a number of 64 bits for each id: half a million hardly ever collide."""
    digests = (hashlib.sha256(name.encode()).digest()[:8] for name in scenario_ids)
    return np.frombuffer(b"".join(digests), "<u8")
