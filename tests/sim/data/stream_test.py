"""Tests that a store streams through a bank whole, in an order that resumes."""

import json
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners.program import compile_replacement
from drivetrain.sim.data import bank, pages, prepare, store
from drivetrain.sim.data.loader import Source, SourceError
from drivetrain.sim.data.pack import PackConfig
from drivetrain.sim.data.pages import Layout
from drivetrain.sim.data.query import Query
from drivetrain.sim.data.stream import Part, Stream, StreamConfig
from drivetrain.sim.scene import Scene

NUM_SCENARIOS = 40
MANY = 1000  # objects: no cap
CONFIG = StreamConfig(resident=12, pages=3, updates_per_page=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    out = tmp_path_factory.mktemp("stores") / "store"
    prepare.prepare([range(NUM_SCENARIOS)], out, PackConfig())
    return out


def stream_of(folder: pathlib.Path, num_devices: int = 1, **kwargs) -> Stream:
    return Stream(Source(path=str(folder)), CONFIG, MANY, num_devices, **kwargs)


def held(state: dict) -> list[int]:
    """Returns the numbers of the scenarios that are in the bank."""
    return [number for page in state["held"] for own in page for number in own]


def where_valid(pieces):
    """Blanks what means nothing."""

    def blank(leaf: jax.Array) -> jax.Array:
        mask = pieces.valid.reshape(-1, *[1] * (leaf.ndim - 1))
        return jnp.where(mask, leaf, jnp.zeros_like(leaf))

    return jax.tree.map(blank, pieces)


@jax.jit
def shown(banked: bank.Bank, index: jax.Array):
    """Returns what tells a scenario from others: its log, map, paths and signs."""
    scene = Scene(bank=banked, index=index)
    steps = jnp.arange(banked.sizes.num_steps)
    line = 10.0 * jnp.arange(-3.0, 4.0)
    points = jnp.stack(jnp.meshgrid(line, line, jnp.zeros(1)), -1)
    return (
        jax.vmap(scene.log_at)(steps),
        jax.vmap(scene.lights_at)(steps),
        where_valid(scene.map_segments()),
        where_valid(scene.path_segments()),
        scene.stop_signs(),
        scene.object_size,
        scene.nearest_edge(points.reshape(-1, 3)),
    )


def assert_shows(found: bank.Bank, numbers: list[int], folder: pathlib.Path) -> None:
    """Checks that a bank shows records of the store in this order."""
    records = store.Records(folder)
    # Room for any, so that one program shows them all.
    room = Layout.of(store.entries(folder), MANY, 3, 4).capacity
    for place, number in enumerate(numbers):
        alone = bank.build([records[number]], found.sizes, room)
        wanted = shown(alone, jnp.int32(0))
        seen = shown(found, jnp.int32(place))
        jax.tree.map(np.testing.assert_array_equal, seen, wanted)


def test_a_filled_bank_shows_the_scenarios_that_its_state_names(folder):
    stream = stream_of(folder)
    filled = stream.fill()
    own = jax.tree.map(lambda leaf: leaf[0], filled)
    assert own.num_scenarios == 12
    assert len(set(held(stream.state))) == 12
    assert_shows(own, held(stream.state), folder)
    stream.close()


def test_a_page_takes_the_place_of_another_and_moves_none(folder):
    stream = stream_of(folder)
    filled = jax.device_put(stream.fill())
    replace = compile_replacement()
    for _ in range(4):
        page = stream.take()
        filled = replace(filled, page.bank, jnp.int32(page.number))
        own = jax.tree.map(lambda leaf: leaf[0], filled)
        assert own.num_scenarios == 12
        assert_shows(own, held(page.state), folder)
    stream.close()


def test_every_scenario_comes_once_in_a_round(folder):
    stream = stream_of(folder)
    stream.fill()
    drawn = held(stream.state)
    while len(drawn) < NUM_SCENARIOS:
        page = stream.take()
        drawn += page.state["held"][page.number][0]
    waiting = len(page.state["waiting"])
    stream.close()
    # 12 and 7 pages of 4 are the 40; what did not fit waits for later pages.
    assert len(set(drawn)) >= NUM_SCENARIOS - waiting
    assert len(drawn) - len(set(drawn)) <= waiting


@pytest.mark.parametrize("num_devices", [1, 2])
def test_a_stream_goes_on_as_if_it_was_not_cut(folder, num_devices):
    whole = stream_of(folder, num_devices)
    whole.fill()
    for _ in range(3):
        whole.take()
    state = json.loads(json.dumps(whole.state))  # as a checkpoint keeps it
    resumed = stream_of(folder, num_devices)
    again = resumed.fill(state)
    assert held(resumed.state) == held(whole.state)
    own = jax.tree.map(lambda leaf: leaf[0], again)
    assert_shows(own, [n for page in state["held"] for n in page[0]], folder)
    for _ in range(5):
        one, other = whole.take(), resumed.take()
        assert (one.number, one.state) == (other.number, other.state)
        jax.tree.map(np.testing.assert_array_equal, one.bank, other.bank)
    whole.close()
    resumed.close()


def test_restoring_drops_what_was_begun(folder):
    stream = stream_of(folder)
    stream.fill()
    state = stream.state
    first = stream.take()
    stream.fill(state)
    assert stream.take().state == first.state
    stream.close()


def test_processes_share_nothing(folder):
    source = Source(path=str(folder))
    drawn = []
    for process in range(2):
        stream = Stream(
            source, CONFIG, MANY, 1, part=Part(process=process, num_processes=2)
        )
        stream.fill()
        drawn.append({*held(stream.state), *held(stream.take().state)})
        stream.close()
    assert not drawn[0] & drawn[1]
    assert {number % 2 for number in drawn[0]} == {0}


def test_only_wanted_scenarios_come(folder):
    query = Query(lights=True)
    entries = store.entries(folder)
    stream = Stream(Source(path=str(folder), query=query), CONFIG, MANY, 1)
    stream.fill()
    for _ in range(4):
        assert all(entries[n].num_lights for n in held(stream.take().state))
    stream.close()


def test_what_cannot_stream_is_refused(folder):
    with pytest.raises(ValueError, match="'synthetic:0:9' cannot stream: it is no st"):
        Stream(Source(path="synthetic:0:9"), CONFIG, MANY, 1)
    with pytest.raises(SourceError, match="has 40 scenarios of those wanted, fewer"):
        Stream(Source(path=str(folder)), StreamConfig(resident=48), MANY, 1)
    with pytest.raises(ValueError, match="multiple of 3 pages on 5 devices, got 12"):
        stream_of(folder, 5)
    with pytest.raises(ValueError, match="resident must be at least the 8 pages"):
        StreamConfig(resident=5)


def test_scenarios_that_do_not_fit_wait_for_the_next_page():
    sizes = np.array([[0.5], [0.5], [0.3], [0.3], [0.4], [0.2], [0.3], [0.1]])
    order = iter(range(8))
    chosen, waiting = pages.choose(sizes, 3, [], order)
    # 0 and 1 fill the page; when 2, 3 and 4 wait, 0 makes room for 5, and 6 fits too.
    assert (chosen, waiting) == ([1, 5, 6], [2, 3, 4, 0])
    assert list(order) == [7]


def test_pages_are_filled_though_large_scenarios_wait():
    sizes = np.array([[0.9], [0.8], [0.7], [0.2], [0.1]])
    chosen, waiting = pages.choose(sizes, 2, [0, 1, 2], iter([3, 4]))
    # None of the large ones fits beside another: the largest makes room.
    assert (sorted(chosen), sorted(waiting)) == ([3, 4], [0, 1, 2])


def test_pages_that_hold_nothing_are_refused():
    with pytest.raises(ValueError, match="no 2 scenarios fit into a page together"):
        pages.choose(np.array([[0.9]]), 2, [], iter([0] * 1000))


def test_pages_have_room_for_their_largest_scenario(folder):
    entries = store.entries(folder)
    layout = Layout.of(entries, MANY, 3, 1)
    assert (layout.sizes_of(entries) <= 1.0).all()
