"""Tests what a training run drives on, and that it goes on where it was."""

import json
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import pytest

from drivetrain.launch import feeds
from drivetrain.learners import mesh as meshes
from drivetrain.sim.data import prepare
from drivetrain.sim.data.loader import Source
from drivetrain.sim.data.pack import PackConfig
from drivetrain.sim.data.stream import Stream, StreamConfig

NUM_SCENARIOS = 16
CONFIG = StreamConfig(resident=4, pages=2, updates_per_page=1)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    out = tmp_path_factory.mktemp("stores") / "store"
    prepare.prepare([range(NUM_SCENARIOS)], out, PackConfig())
    return Source(path=str(out))


def opened(source: Source, saved: Mapping[str, Any] | None = None) -> feeds.Feed:
    return feeds.open_feed(source, CONFIG, 64, meshes.data_mesh(), 8, 0, saved)


def kept(feed: feeds.Feed) -> Mapping[str, Any]:
    """Returns what a checkpoint keeps of a feed."""
    found = {**feed.identity, "layout": feed.layout, "feed": feed.state()}
    return json.loads(json.dumps(found))


def held(feed: feeds.Feed) -> set[int]:
    """Returns the numbers of the scenarios in the bank."""
    (state,) = feed.state()["of_processes"]
    return {n for page in state["held"] for own in page for n in own}


@pytest.fixture
def fills(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Returns the states from which banks were filled, as it happens."""
    found, fill = [], Stream.fill

    def noted(stream: Stream, state: Mapping[str, Any] | None = None):
        found.append(state)
        return fill(stream, state)

    monkeypatch.setattr(Stream, "fill", noted)
    return found


def drive(feed: feeds.Feed, num_pages: int) -> None:
    for done in range(num_pages):
        feed.begin(done)
        feed.exchange()


@pytest.mark.parametrize("at_once", [True, False])
def test_a_feed_goes_on_where_it_was(source, at_once):
    whole = opened(source)
    drive(whole, 3)
    saved = kept(whole)
    resumed = opened(source, saved if at_once else None)
    resumed.restore(saved["feed"])
    for feed in (whole, resumed):
        drive(feed, 2)
    jax.tree.map(np.testing.assert_array_equal, resumed.bank, whole.bank)
    assert resumed.state() == whole.state()
    for feed in (whole, resumed):
        feed.close()


def test_a_feed_that_goes_on_fills_the_bank_once(source, fills):
    whole = opened(source)
    drive(whole, 1)
    saved = kept(whole)
    fills.clear()

    resumed = opened(source, saved)
    resumed.restore(saved["feed"])

    assert fills == saved["feed"]["of_processes"]
    for feed in (whole, resumed):
        feed.close()


def test_what_another_feed_kept_is_not_looked_at(source, fills):
    feed = opened(source, {"scenarios": "others", "layout": {}, "feed": {"held": 3}})

    assert fills == [None]
    feed.close()


def test_processes_draw_from_shares_of_their_own(source, monkeypatch):
    drawn = []
    for process in range(2):
        with monkeypatch.context() as job:
            job.setattr(feeds.jax, "process_count", lambda: 2)
            job.setattr(feeds.jax, "process_index", lambda p=process: p)
            feed = opened(source)
        drawn.append(held(feed))
        feed.close()

    assert {number % 2 for number in drawn[0]} == {0}
    assert {number % 2 for number in drawn[1]} == {1}
