"""Tests what a summary says of a store beyond its counts."""

import dataclasses

import pytest

from drivetrain.launch import summary
from drivetrain.sim.data.bank import MAX_ROWS
from drivetrain.sim.data.entry import Entry, entry_of
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.synthetic import generate as synthetic


@pytest.fixture(scope="module")
def entry() -> Entry:
    return entry_of(pack(synthetic.generate(0), PackConfig()))


def line_about_rows(entry: Entry, **rows: int) -> str:
    """Returns the line about the bank of a store of one scenario."""
    changed = dataclasses.replace(entry, rows=entry.rows | rows)
    lines = summary.lines(summary.summarize([changed]))
    return next(line for line in lines if line.startswith("In the bank"))


def test_the_rows_of_all_of_womd_are_told(entry):
    line = line_about_rows(entry, nodes=4000)

    # 487,000 scenarios of 4,000 rows are 1.948 billion.
    assert "(nodes) has 1.95 of the 2.15 billion rows" in line
    assert "do not fit" not in line


def test_more_rows_than_a_device_can_number_are_told(entry):
    line = line_about_rows(entry, vertices=2 * MAX_ROWS // 487_000)

    assert "(vertices) has 4.29" in line
    assert "they do not fit, use 2 devices or more" in line


def test_the_sources_of_routes_and_egos_are_told_for_each_format(entry):
    other = dataclasses.replace(entry, dataset="womd_json", ego_source="last")

    lines = summary.lines(summary.summarize([entry, other, other]))

    assert "womd_json: routes from lane_graph 2; egos last 2." in lines
    assert "synthetic: routes from lane_graph 1; egos marked 1." in lines
