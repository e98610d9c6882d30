"""Tests the sums over the lists of shards."""

import pickle
from collections import Counter
from typing import Any

import numpy as np

from drivetrain.sim.data import tally

HASH_BYTES = 8
REST_BYTES = 2000  # of a pickled tally: names of fields, two counters


def listing(*scenario_ids: str, **changes: Any) -> dict[str, Any]:
    """Returns the list of a shard, with what a tally looks at."""
    fields = {
        "num_bytes": 100,
        "quantum": 0.01,
        "num_index_dropped": 2,
        "rows": {"blocks": 5, "nodes": 7},
        "dataset": "womd_json",
        "route_source": "lane_ends",
        **changes,
    }
    return {
        "bad": [{"file": "x", "record": 3, "reason": "why"}],
        "scenarios": [{"scenario_id": name, **fields} for name in scenario_ids],
    }


def test_tallies_add_up():
    one = tally.tally_of(listing("a", "b"))
    other = tally.tally_of(listing("c", quantum=0.02, route_source="log"))

    both = tally.total([one, other])

    assert (both.num_scenarios, both.num_bytes, both.num_coarse) == (3, 300, 1)
    assert (both.num_index_dropped, both.num_index_listed) == (6, 15)
    assert both.datasets == Counter(womd_json=3)
    assert both.route_sources == Counter(lane_ends=2, log=1)
    assert len(both.bad) == 2


def test_ids_that_come_twice_are_found_across_shards():
    tallies = [tally.tally_of(listing(*names)) for names in ("ab", "cad", "e")]

    np.testing.assert_array_equal(tally.total(tallies).repeated(), tally.hashes("a"))


def test_a_tally_costs_eight_bytes_a_scenario():
    names = [f"{number:016x}" for number in range(10_000)]

    size = len(pickle.dumps(tally.tally_of(listing(*names))))

    assert size <= HASH_BYTES * len(names) + REST_BYTES
