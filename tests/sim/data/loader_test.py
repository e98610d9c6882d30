"""Tests that sources give the scenarios they name, split by scenario."""

import os
import pathlib

import orjson
import pytest

from drivetrain.sim.data import inputs, loader, prepare, store, workers
from drivetrain.sim.data.loader import Source, SourceError
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.data.workers import WorkerError
from tests.sim.data import files

NUM_FILES = 6
SHARE_ERROR = 0.03  # two standard deviations of a third of 1,000


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    """Returns a folder of files with one scenario each."""
    for seed in range(NUM_FILES):
        document = files.json_document(files.scenario(seed))
        (tmp_path / f"{seed}.json").write_bytes(orjson.dumps(document))
    return tmp_path


def ids(scenarios: list[Packed]) -> list[str]:
    """Returns the ids of scenarios, in their order."""
    return [scenario.scenario_id for scenario in scenarios]


def same(found: list[Packed], wanted: list[Packed]) -> bool:
    """Tells whether scenarios are equal to the last bit."""
    return [*map(store.encode, found)] == [*map(store.encode, wanted)]


def test_files_loaded_directly_equal_the_store_made_of_them(folder, tmp_path):
    paths = sorted(folder.glob("*.json"))
    prepare.prepare(paths, tmp_path / "store", PackConfig())

    direct = loader.load(Source(path=str(folder / "*.json")))
    stored = loader.load(Source(path=str(tmp_path / "store")))

    assert len(direct) == NUM_FILES
    assert same(stored, direct)


def test_generated_scenarios_are_those_of_the_seeds():
    wanted = [pack(synthetic.generate(seed), PackConfig()) for seed in (5, 6, 7)]

    assert same(loader.load(Source(path="synthetic:5:3")), wanted)


def test_quantisation_is_off_where_the_source_says_so(folder):
    for path in ("synthetic:0:1", str(folder / "0.json")):
        (exact,) = loader.load(Source(path=path, quantize=False))

        assert exact.poses.dtype == "float32"


@pytest.mark.parametrize("share", [0.1, 1 / 3, 0.9])
def test_train_and_test_share_nothing_and_are_everything(share):
    names = [f"scenario-{i}" for i in range(1000)]
    train = {name for name in names if loader.in_split(name, "train", share)}
    test = {name for name in names if loader.in_split(name, "test", share)}

    assert train | test == set(names)
    assert not train & test
    assert abs(len(test) / len(names) - share) < SHARE_ERROR


@pytest.mark.parametrize(("share", "wanted"), [(0.0, False), (1.0, True)])
def test_a_share_of_nothing_or_all_is_exact(share, wanted):
    names = map(str, range(300))

    assert {loader.in_split(name, "test", share) for name in names} == {wanted}


def test_a_larger_test_share_takes_from_train_and_moves_nothing_back():
    names = [f"scenario-{i}" for i in range(300)]
    small = {name for name in names if loader.in_split(name, "test", 0.2)}
    large = {name for name in names if loader.in_split(name, "test", 0.5)}

    assert small < large


def test_splits_of_a_source_are_disjoint_and_complete():
    train, test, every = (
        ids(loader.load(Source(path="synthetic:0:12", split=split)))
        for split in ("train", "test", "all")
    )

    assert train and test
    assert sorted(train + test) == sorted(every)


def test_adding_files_moves_no_scenario_to_another_split(folder):
    before = ids(loader.load(Source(path=str(folder / "*.json"), split="train")))
    for seed in range(100, 103):
        document = files.json_document(files.scenario(seed))
        (folder / f"0-{seed}.json").write_bytes(orjson.dumps(document))

    after = ids(loader.load(Source(path=str(folder / "*.json"), split="train")))

    assert [name for name in after if name in before] == before
    assert not {f"{seed:016x}" for seed in range(NUM_FILES)} & set(after) - set(before)


def test_a_limit_takes_the_first_of_the_split():
    every = loader.load(Source(path="synthetic:0:9", split="train"))
    first = loader.load(Source(path="synthetic:0:9", split="train", max_scenarios=2))

    assert same(first, every[:2])


def test_progress_counts_scenarios_and_knows_a_total(folder, tmp_path):
    calls = []
    prepare.prepare(
        [folder / "0.json", folder / "1.json"], tmp_path / "s", PackConfig()
    )
    for path in ("synthetic:0:2", str(tmp_path / "s"), str(folder / "[01].json")):
        source = Source(path=path)
        total = loader.count(source)
        loader.load(source, lambda done, total=total: calls.append((done, total)))

    assert calls == [(1, 2), (2, 2), (1, 2), (2, 2), (1, None), (2, None)]


def test_a_share_is_what_all_has_under_its_numbers(folder, tmp_path):
    prepare.prepare(sorted(folder.glob("*.json")), tmp_path / "s", PackConfig())
    for path in ("synthetic:0:4", str(tmp_path / "s"), str(folder / "*.json")):
        source = Source(path=path)
        every = loader.load(source)
        asked = []
        count, own = loader.load_share(
            source, lambda count, asked=asked: asked.append(count) or [3, 1]
        )
        assert asked == [count] == [len(every)]
        assert set(own) == {1, 3}
        assert same([own[1], own[3]], [every[1], every[3]])


@pytest.mark.parametrize(
    "text",
    [
        "synthetic:",
        "synthetic:1",
        "synthetic:0:8:2",
        "synthetic:a:8",
        "synthetic:-1:8",
        "synthetic:0:1.5",
        "synthetic::",
    ],
)
def test_a_malformed_generator_is_shown_how_it_is_written(text):
    with pytest.raises(ValueError, match=r"synthetic:FIRST:COUNT.*synthetic:0:256"):
        loader.load(Source(path=text))


def test_a_generator_of_nothing_is_refused():
    with pytest.raises(ValueError, match="COUNT must be at least 1"):
        loader.load(Source(path="synthetic:3:0"))


@pytest.mark.parametrize("name", ["none", "none/*.json", "synthetic"])
def test_an_unknown_path_is_named_with_what_could_stand_there(tmp_path, name):
    with pytest.raises(FileNotFoundError, match=r"no file matches.*prepare"):
        loader.load(Source(path=str(tmp_path / name)))


def test_a_folder_that_is_no_store_is_said_to_be_none(folder):
    with pytest.raises(FileNotFoundError, match=r"holds no store; .*pattern such as"):
        loader.load(Source(path=str(folder)))


def test_a_damaged_shard_is_named(folder, tmp_path):
    out = tmp_path / "store"
    prepare.prepare([folder / "0.json"], out, PackConfig())
    (out / "shard-00000.array_record").write_bytes(b"cut off")

    with pytest.raises(store.StoreError, match="shard-00000"):
        loader.load(Source(path=str(out)))


def test_files_without_a_usable_scenario_are_named_with_the_reason(tmp_path):
    (tmp_path / "bad.json").write_text('{"objects": 3}')

    with pytest.raises(SourceError, match=r"no usable scenario.*bad.json, record 0:"):
        loader.load(Source(path=str(tmp_path / "*.json")))


def test_an_empty_split_is_named():
    with pytest.raises(SourceError, match="all 1 are in split train; change"):
        loader.load(Source(path="synthetic:0:1", split="test", test_share=1e-9))


def test_bad_records_among_good_ones_are_passed_over(folder):
    (folder / "3.json").write_text('{"objects": 3}')

    assert len(loader.load(Source(path=str(folder / "*.json")))) == NUM_FILES - 1


def test_a_name_with_brackets_is_a_file_if_there_is_one(folder):
    (folder / "0.json").rename(folder / "log[0].json")

    assert len(loader.load(Source(path=str(folder / "log[0].json")))) == 1


def test_files_of_a_pattern_come_sorted_and_without_folders(folder):
    (folder / "a.json").mkdir()

    found = inputs.matching_files(str(folder / "*.json"))

    assert found == [folder / f"{seed}.json" for seed in range(NUM_FILES)]


def test_workers_give_the_same_scenarios_in_the_same_order(folder, monkeypatch):
    monkeypatch.setattr(inputs, "PIECE", 1)
    monkeypatch.setattr(inputs, "MANY_PIECES", 2)
    (folder / "2.json").write_text("{")
    for path in ("synthetic:3:4", str(folder / "*.json")):
        alone = loader.load(Source(path=path))
        assert same(loader.load(Source(path=path), num_workers=2), alone)


def test_a_killed_worker_is_told(monkeypatch):
    with pytest.raises(WorkerError, match="a worker process was killed"):
        with workers.pool(1) as pool:
            pool.submit(os._exit, 9).result()
