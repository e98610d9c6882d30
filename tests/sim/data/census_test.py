"""Tests that it is said why no scenario is wanted, by counts of a hand-made set."""

import dataclasses

import pytest

from drivetrain.sim.data.census import Census
from drivetrain.sim.data.entry import Entry, entry_of
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.query import Query
from drivetrain.sim.data.synthetic import generate as synthetic


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    """Returns three entries: of 0, 0 and 2 lights, the first at a junction."""
    one = entry_of(pack(synthetic.generate(0), PackConfig()))
    facts = [(0, True), (0, False), (2, False)]
    return [
        dataclasses.replace(one, num_lights=lights, is_at_junction=junction)
        for lights, junction in facts
    ]


def counted(entries: list[Entry], query: Query, split: str = "all", first: int = 0):
    """Returns what is said of the entries, of which those from `first` are in it."""
    census = Census(split, query)
    wanted = [
        census.admits(number >= first, lambda entry=entry: entry)
        for number, entry in enumerate(entries)
    ]
    assert not any(wanted)
    return census.sentence()


def test_each_condition_is_counted_as_it_is_typed(entries):
    query = Query(lights=True, junction=True)

    assert counted(entries, query) == (
        "3 scenarios, 1 of them with junction=true, 1 of them with lights=true, "
        "none with all of it"
    )


def test_only_those_of_the_split_are_counted(entries):
    query = Query(junction=True)

    assert counted(entries, query, "train", first=2) == (
        "1 scenario in split train, 0 of them with junction=true"
    )


def test_a_split_without_scenarios_is_named(entries):
    said = counted(entries, Query(), "test", first=3)

    assert said == "all 3 are in split train; change split or test_share"


def test_a_dataset_that_nobody_has_lists_those_there_are(entries):
    said = counted(entries, Query(dataset="bogus"))

    assert (
        said == "3 scenarios, 0 of them with dataset=bogus; datasets in it: synthetic"
    )


def test_nothing_is_said_of_nothing():
    assert Census("all", Query(lights=True)).sentence() == ""


@pytest.mark.parametrize("name", ["min_objects", "max_objects"])
def test_a_negative_count_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} must be at least 0, got -5"):
        dataclasses.replace(Query(), **{name: -5})


def test_a_scenario_is_looked_at_where_a_query_asks_alone():
    def entry() -> Entry:
        raise AssertionError("looked")

    assert Census("all", Query()).admits(True, entry)
    assert not Census("train", Query(lights=True)).admits(False, entry)
