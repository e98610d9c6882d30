"""Tests that a store is continued from the same files by the same version alone."""

import os
import pathlib

import orjson
import pytest

from drivetrain.sim.data import plan, prepare, store
from drivetrain.sim.data.pack import PackConfig
from drivetrain.sim.data.timeline import Timeline
from tests.sim.data import files


@pytest.fixture
def paths(tmp_path: pathlib.Path) -> list[pathlib.Path]:
    """Returns files of one scenario each."""
    made = [tmp_path / f"{seed}.json" for seed in range(2)]
    for seed, path in enumerate(made):
        path.write_bytes(orjson.dumps(files.json_document(files.scenario(seed))))
    return made


@pytest.fixture
def out(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / "made" / "store"


@pytest.fixture
def made(paths, out) -> pathlib.Path:
    """Returns a finished store."""
    prepare.prepare(paths, out, PackConfig())
    return out


def contents(folder: pathlib.Path) -> dict[str, bytes]:
    """Returns the bytes of each file of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize(
    ("chosen", "change", "what"),
    [
        (slice(1, 2), {}, "1 gone, such as '.*0.json'"),
        (slice(None, None, -1), {}, "the order of the files"),
        (slice(0, 2), {"quantize": False}, "quantize was True, now False"),
        (
            slice(0, 2),
            {"timeline": Timeline(current_step=12)},
            "timeline.current_step was None, now 12",
        ),
    ],
    ids=["fewer files", "order", "settings", "timeline"],
)
def test_a_folder_of_other_files_or_settings_is_left_alone(
    paths, made, chosen, change, what
):
    before = contents(made)

    sentence = f"other files or settings: {what}; name another"
    with pytest.raises(FileExistsError, match=sentence):
        prepare.prepare(paths[chosen], made, PackConfig(**change))

    assert contents(made) == before


def test_new_files_are_counted_and_the_first_named(paths, made, tmp_path):
    more = [tmp_path / f"new{number}.json" for number in range(3)]
    for path in more:
        path.write_bytes(paths[0].read_bytes())

    with pytest.raises(
        FileExistsError, match=r"settings: 3 new, such as '.*new0.json';"
    ):
        prepare.prepare([*paths, *more], made, PackConfig())


def test_a_file_that_grew_makes_another_store(paths, made):
    paths[0].write_bytes(paths[0].read_bytes() + b"\n")

    with pytest.raises(FileExistsError, match=r"'.*0.json' has changed since"):
        prepare.prepare(paths, made, PackConfig())


def test_a_file_overwritten_by_one_of_the_same_size_makes_another_store(paths, made):
    content = paths[1].read_bytes()
    paths[1].write_bytes(content[::-1])
    later = paths[1].stat().st_mtime_ns + 10**9
    os.utime(paths[1], ns=(later, later))  # clocks may be coarse

    with pytest.raises(FileExistsError, match=r"'.*1.json' has changed.*delete this"):
        prepare.prepare(paths, made, PackConfig())


@pytest.mark.parametrize("field", ["format_version", "versions"])
def test_a_store_of_another_version_is_not_relabelled(paths, made, field, monkeypatch):
    before = contents(made)
    change = (
        (store, "FORMAT_VERSION", store.FORMAT_VERSION + 1)
        if field == "format_version"
        else (plan, "versions", lambda: {"drivetrain": "of another year"})
    )
    monkeypatch.setattr(*change)

    with pytest.raises(FileExistsError, match=r"another version began.*name another"):
        prepare.prepare(paths, made, PackConfig())

    assert contents(made) == before


def test_a_store_from_before_versions_were_planned_is_not_relabelled(paths, made):
    before = store.read_json(made / plan.PLAN)
    del before["format_version"]
    store.write_json(made / plan.PLAN, before)

    with pytest.raises(FileExistsError, match=r"format None, now \d"):
        prepare.prepare(paths, made, PackConfig())


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"pack": {}, "inputs": [3]}'])
def test_a_damaged_plan_is_named_with_the_cure(paths, made, content):
    (made / plan.PLAN).write_bytes(content)

    with pytest.raises(store.StoreError, match=r"plan.json' is damaged.*delete the fo"):
        prepare.prepare(paths, made, PackConfig())


def test_a_folder_of_something_else_is_left_alone(paths, tmp_path):
    before = contents(tmp_path)

    with pytest.raises(FileExistsError, match="name a new folder"):
        prepare.prepare(paths, tmp_path, PackConfig())
    with pytest.raises(FileExistsError, match="name a new folder"):
        prepare.prepare(paths, paths[0], PackConfig())

    assert contents(tmp_path) == before


def test_an_empty_folder_is_taken(paths, out):
    out.mkdir(parents=True)

    assert prepare.prepare(paths, out, PackConfig()).num_scenarios == len(paths)
