"""Tests that queries choose scenarios by facts that an independent look confirms."""

import dataclasses
import pathlib

import numpy as np
import pytest

from drivetrain.sim.data import bank, entry, loader, prepare, store
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.data.query import EVERYTHING, Query
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.scenario import Scenario
from tests.sim.data import files

NUM_SEEDS = 24
ROUNDING = 0.02  # metres, and metres per second: quantised, and rounded to hundredths


@pytest.fixture(scope="module")
def sources() -> list[Scenario]:
    return [synthetic.generate(seed) for seed in range(NUM_SEEDS)]


@pytest.fixture(scope="module")
def packed(sources: list[Scenario]) -> list[Packed]:
    return [pack(source, PackConfig()) for source in sources]


@pytest.fixture(scope="module")
def entries(packed: list[Packed]) -> list[entry.Entry]:
    return [entry.entry_of(one) for one in packed]


def ego_way(source: Scenario) -> np.ndarray:
    """Returns the places of the ego from the current step on."""
    valid = source.tracks.valid[source.ego_index].copy()
    valid[: source.current_step] = False
    return source.tracks.xyz[source.ego_index, valid, :2]


def least_encounter(source: Scenario) -> float | None:
    """Searches step by step for the least time between the ego and a moving other.

    As documented: every other step, centres within 2.5 m, of those who get 1 m away.
    """
    tracks, ego = source.tracks, source.ego_index
    steps = range(source.current_step, source.num_steps, 2)
    found = []
    for other in range(len(tracks.object_id)):
        places = tracks.xyz[other][tracks.valid[other]]
        away = np.linalg.norm((places - places[0])[:, :2], axis=1).max()
        if other == ego or away < 1.0:
            continue
        for t in steps:
            for u in steps:
                if tracks.valid[ego, t] and tracks.valid[other, u]:
                    gap = tracks.xyz[ego, t, :2] - tracks.xyz[other, u, :2]
                    if np.hypot(*gap) <= 2.5:
                        found.append(abs(t - u) * source.dt)
    return min(found) if found else None


def test_the_ego_moves_as_its_log_does(sources, entries):
    for source, found in zip(sources, entries, strict=True):
        way = ego_way(source)
        speed = source.tracks.velocity[source.ego_index, source.current_step :]
        assert found.ego_distance == pytest.approx(
            np.linalg.norm(way - way[0], axis=1).max(), abs=ROUNDING
        )
        assert found.ego_speed == pytest.approx(
            np.linalg.norm(speed, axis=1).mean(), abs=ROUNDING
        )


def test_encounters_are_those_of_a_search_over_all_pairs(sources, entries):
    found = [one.encounter for one in entries[:6]]
    wanted = [least_encounter(source) for source in sources[:6]]
    assert any(time is not None for time in wanted)
    for one, other in zip(found, wanted, strict=True):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            # A centimetre of rounding may let a meeting be seen one look later.
            assert abs(one - other) <= 2 * 0.1 + ROUNDING


def test_counts_are_those_of_the_scenario(sources, entries):
    for source, found in zip(sources, entries, strict=True):
        kinds = source.tracks.object_type[source.tracks.valid.any(axis=1)]
        assert found.num_vehicles == (kinds == 1).sum()
        assert found.num_pedestrians == (kinds == 2).sum()
        assert found.num_cyclists == (kinds == 3).sum()
        assert found.num_objects == len(kinds)
        assert found.num_lights == source.lights.valid.any(axis=1).sum()


def test_bytes_are_what_a_bank_grows_by(packed, entries):
    sizes = bank.Sizes.of(packed, 1000)

    def num_bytes(count: int) -> int:
        made = bank.build(packed[:count], sizes)
        return sum(value.nbytes for value in vars(made).values() if value is not sizes)

    for count in range(1, 6):
        grown = num_bytes(count + 1) - num_bytes(count)
        # Words of validity bits are as many as the longest log of the bank needs.
        assert grown == entries[count].num_bytes


def test_sizes_follow_from_entries_as_from_scenarios(packed, entries):
    assert bank.Sizes.of(entries, 20) == bank.Sizes.of(packed, 20)


def found_by(entries: list[entry.Entry], **wanted) -> set[str]:
    query = Query(**wanted)
    return {one.scenario_id for one in entries if query.matches(one)}


@pytest.mark.parametrize(
    ("name", "facts", "is_so"),
    [
        ("moving_ego", {"ego_distance": 0.21}, True),
        ("moving_ego", {"ego_distance": 0.20}, False),
        ("interactive", {"encounter": 3.0}, True),
        ("interactive", {"encounter": 3.1}, False),
        ("interactive", {"encounter": None}, False),
        ("junction", {"is_at_junction": True}, True),
        ("junction", {"is_at_junction": False}, False),
        ("feasible_goal", {"is_goal_feasible": True}, True),
        ("feasible_goal", {"is_goal_feasible": False}, False),
        ("lights", {"num_lights": 1}, True),
        ("lights", {"num_lights": 0}, False),
    ],
)
def test_each_fact_is_wanted_absent_or_does_not_matter(entries, name, facts, is_so):
    one = dataclasses.replace(entries[0], **facts)

    assert Query(**{name: True}).matches(one) == is_so
    assert Query(**{name: False}).matches(one) != is_so
    assert Query().matches(one)


def test_facts_and_counts_are_what_they_say(entries):
    by_id = {one.scenario_id: one for one in entries}
    for name in found_by(entries, lights=True, min_objects=8, max_objects=14):
        assert by_id[name].num_lights and 8 <= by_id[name].num_objects <= 14
    assert found_by(entries, dataset="womd_json") == set()
    some = dataclasses.replace(entries[0], encounter=3.1, ego_distance=0.2)
    assert not Query(interactive=True).matches(some)
    assert Query(interactive=False, moving_ego=False).matches(some)


def test_bounds_that_no_count_meets_are_refused():
    with pytest.raises(ValueError, match="at least 5 and at most 4 objects"):
        Query(min_objects=5, max_objects=4)


def test_a_store_and_its_seeds_give_the_same_scenarios(tmp_path: pathlib.Path):
    out, query = tmp_path / "store", Query(lights=True, min_objects=9)
    prepare.prepare([range(NUM_SEEDS)], out, PackConfig())
    loaded = [
        loader.load(loader.Source(path=path, query=query, split="train"))
        for path in (str(out), f"synthetic:0:{NUM_SEEDS}")
    ]
    stored, generated = ([one.scenario_id for one in some] for some in loaded)
    assert stored == generated and 0 < len(stored) < NUM_SEEDS


def test_nothing_found_names_the_query(tmp_path: pathlib.Path):
    source = loader.Source(path="synthetic:0:2", query=Query(min_objects=999))
    with pytest.raises(loader.SourceError, match="min_objects=999"):
        loader.load(source)


@pytest.mark.parametrize("is_store", [True, False])
def test_an_unknown_dataset_is_answered_with_those_that_are_there(tmp_path, is_store):
    path = "synthetic:0:2"
    if is_store:
        path = str(tmp_path / "store")
        prepare.prepare([range(2)], tmp_path / "store", PackConfig())
    source = loader.Source(path=path, query=Query(dataset="bogus"))
    with pytest.raises(loader.SourceError, match=r"; datasets in it: synthetic\.$"):
        loader.load(source)


def test_a_missing_list_is_named(tmp_path: pathlib.Path):
    out = tmp_path / "store"
    prepare.prepare([range(2)], out, PackConfig())
    (out / "shard-00000.json").write_text("{")
    with pytest.raises(store.StoreError, match=r"shard-00000.json' is damaged"):
        store.entries(out)


def test_an_ego_that_stands_is_at_no_junction():
    source = files.scenario(0)
    tracks = dataclasses.replace(
        source.tracks,
        xyz=np.zeros_like(source.tracks.xyz),
        velocity=np.zeros_like(source.tracks.velocity),
    )
    found = entry.entry_of(
        pack(dataclasses.replace(source, tracks=tracks), PackConfig())
    )
    assert (found.is_at_junction, found.ego_distance) == (False, 0.0)
    assert EVERYTHING.matches(found)
