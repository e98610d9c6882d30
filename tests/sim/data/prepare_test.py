"""Tests that a store is made whole, continued where it was cut, or not at all."""

import json
import pathlib
import random
import signal
import subprocess
import sys
import time

import orjson
import pytest

from drivetrain.sim.data import bank, plan, prepare, store
from drivetrain.sim.data.pack import PackConfig
from drivetrain.sim.data.shard import RecordError
from tests.sim.data import files, protos

NUM_FILES = 5


@pytest.fixture(autouse=True)
def one_file_per_shard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prepare, "SHARD_BYTES", 1)


@pytest.fixture
def paths(tmp_path: pathlib.Path) -> list[pathlib.Path]:
    """Returns files of two records each."""
    made = []
    for seed in range(NUM_FILES):
        records = [
            protos.scenario_proto(files.scenario(10 * seed + i)) for i in range(2)
        ]
        made.append(tmp_path / f"{seed}.tfrecord")
        made[-1].write_bytes(files.tfrecord(*records))
    return made


@pytest.fixture
def out(tmp_path: pathlib.Path) -> pathlib.Path:
    return tmp_path / "made" / "store"


def spoil(path: pathlib.Path) -> None:
    """Makes the second of three records of a file bad."""
    good = [protos.scenario_proto(files.scenario(90 + i)) for i in range(2)]
    path.write_bytes(files.tfrecord(good[0], b"\xff", good[1]))


def contents(folder: pathlib.Path) -> dict[str, bytes]:
    """Returns the bytes of each file of a folder."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


class Cut(Exception):
    """Ends a run as a power cut would."""


def cut_after(num_files: int, num_scenarios: int = 0):
    """Returns a tick that ends the run in the file after so many."""

    def tick(files_done: int, scenarios_done: int) -> None:
        if files_done >= num_files and scenarios_done >= num_scenarios:
            raise Cut

    return tick


def test_a_store_holds_the_scenarios_of_its_files_in_order(paths, out):
    summary = prepare.prepare(paths, out, PackConfig())
    wanted = [f"{10 * seed + i:016x}" for seed in range(NUM_FILES) for i in range(2)]

    assert [packed.scenario_id for packed in store.read(out)] == wanted
    assert summary.num_scenarios == len(wanted)
    assert summary.num_shards == NUM_FILES
    assert summary.num_bytes == sum(map(bank.num_bytes, store.read(out)))
    assert (summary.num_continued, summary.bad, summary.duplicates) == (0, [], [])


@pytest.mark.parametrize("num_done", range(NUM_FILES))
def test_a_run_that_was_cut_is_continued_to_the_same_bytes(paths, out, num_done):
    undisturbed = out.with_name("undisturbed")
    prepare.prepare(paths, undisturbed, PackConfig())
    with pytest.raises(Cut):
        tick = cut_after(num_done, 2 * num_done + 1)
        prepare.prepare(paths, out, PackConfig(), tick=tick)
    assert not store.is_store(out)

    summary = prepare.prepare(paths, out, PackConfig())

    assert summary.num_continued == num_done
    assert summary.num_scenarios == 2 * NUM_FILES
    assert contents(out) == contents(undisturbed)


def test_a_cut_leaves_no_half_written_file(paths, out):
    with pytest.raises(Cut):
        prepare.prepare(paths, out, PackConfig(), tick=cut_after(2, 5))

    names = {path.name for path in out.iterdir()}
    done = {f"shard-0000{i}{end}" for i in (0, 1) for end in (".array_record", ".json")}
    assert names == {plan.PLAN} | done


def test_a_shard_whose_list_was_not_written_is_made_anew(paths, out):
    prepare.prepare(paths, out, PackConfig())
    whole = contents(out)
    (out / "shard-00002.json").unlink()
    (out / store.MANIFEST).unlink()

    assert prepare.prepare(paths, out, PackConfig()).num_continued == NUM_FILES - 1
    assert contents(out) == whole


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b'{"sha256": 3, "bad": [], "scenarios": [{"num_bytes": 1}]}'],
)
def test_a_shard_whose_list_is_damaged_is_made_anew(paths, out, content):
    prepare.prepare(paths, out, PackConfig())
    whole = contents(out)
    (out / "shard-00000.json").write_bytes(content)

    assert prepare.prepare(paths, out, PackConfig()).num_continued == NUM_FILES - 1
    assert contents(out) == whole


def test_a_list_that_lost_a_field_of_a_scenario_is_damaged(paths, out):
    prepare.prepare(paths, out, PackConfig())
    whole = contents(out)
    listing = store.read_json(out / "shard-00003.json")
    del listing["scenarios"][1]["encounter"]
    store.write_json(out / "shard-00003.json", listing)

    assert prepare.prepare(paths, out, PackConfig()).num_continued == NUM_FILES - 1
    assert contents(out) == whole


def test_a_finished_store_is_left_as_it_is(paths, out):
    prepare.prepare(paths, out, PackConfig())
    before = contents(out)

    assert prepare.prepare(paths, out, PackConfig()).num_continued == NUM_FILES
    assert contents(out) == before


def test_the_manifest_states_the_digest_of_each_shard(paths, out):
    prepare.prepare(paths, out, PackConfig())

    for shard in store.read_manifest(out)["shards"]:
        assert store.file_digest(out / shard["name"]) == shard["sha256"]


def test_bad_records_are_named_with_file_and_number_and_left_out(paths, out):
    spoil(paths[3])

    summary = prepare.prepare(paths, out, PackConfig())

    (bad,) = summary.bad
    assert (bad["file"], bad["record"]) == (str(paths[3]), 1)
    assert "Scenario message" in bad["reason"]
    assert summary.num_scenarios == len(list(store.read(out))) == 2 * NUM_FILES
    assert store.read_manifest(out)["num_bad_records"] == 1


def test_a_continued_run_still_names_the_bad_records_of_the_first(paths, out):
    spoil(paths[0])
    with pytest.raises(Cut):
        prepare.prepare(paths, out, PackConfig(), tick=cut_after(2))

    assert len(prepare.prepare(paths, out, PackConfig()).bad) == 1


def test_reasons_are_counted_most_frequent_first(paths, out):
    for path in paths[:2]:
        spoil(path)
    paths[2].write_bytes(b"")

    reasons = prepare.prepare(paths, out, PackConfig()).reasons()

    assert [count for _, count in reasons] == [2, 1]
    assert "empty" in reasons[1][0]


def test_a_strict_run_ends_at_the_first_bad_record_and_leaves_nothing(paths, out):
    spoil(paths[3])

    with pytest.raises(RecordError, match=r"3.tfrecord, record 1: "):
        prepare.prepare(paths, out, PackConfig(), strict=True)

    assert not out.exists()


def test_a_strict_run_sees_the_bad_records_of_the_run_that_it_continues(paths, out):
    spoil(paths[0])
    with pytest.raises(Cut):
        prepare.prepare(paths, out, PackConfig(), tick=cut_after(2))

    with pytest.raises(RecordError, match=r"0.tfrecord, record 1: "):
        prepare.prepare(paths, out, PackConfig(), strict=True)


def test_a_strict_run_over_good_files_is_as_any_other(paths, out):
    summary = prepare.prepare(paths, out, PackConfig(), strict=True)

    assert summary.num_scenarios == 2 * NUM_FILES


def test_without_a_usable_record_there_is_no_store(paths, out):
    paths[0].write_bytes(b"nothing known")

    with pytest.raises(RecordError, match=r"no usable scenario in 1 files.*0.tfrecord"):
        prepare.prepare(paths[:1], out, PackConfig())

    assert not out.exists()


def test_ids_that_come_twice_are_listed_and_kept(paths, out):
    paths[1].write_bytes(paths[0].read_bytes())

    summary = prepare.prepare(paths, out, PackConfig())

    assert summary.duplicates == [f"{0:016x}", f"{1:016x}"]
    assert summary.num_scenarios == 2 * NUM_FILES


def test_progress_never_goes_back_and_ends_at_the_totals(paths, out):
    calls = []
    with pytest.raises(Cut):
        prepare.prepare(paths, out, PackConfig(), tick=cut_after(2))

    prepare.prepare(paths, out, PackConfig(), tick=lambda *call: calls.append(call))

    assert calls == sorted(calls)
    assert calls[0] == (1, 2)
    assert calls[-1] == (NUM_FILES, 2 * NUM_FILES)


def test_formats_may_be_mixed(paths, out, tmp_path):
    document = files.json_document(files.scenario(77))
    (tmp_path / "one.json").write_bytes(orjson.dumps(document))

    summary = prepare.prepare([paths[0], tmp_path / "one.json"], out, PackConfig())

    assert summary.num_scenarios == 3
    listing = json.loads((out / "shard-00001.json").read_text())
    assert listing["scenarios"][0]["scenario_id"] == f"{77:016x}"


def test_several_workers_make_the_same_bytes(paths, out):
    spoil(paths[3])
    prepare.prepare(paths, out, PackConfig())
    calls = []

    other = out.with_name("other")
    prepare.prepare(paths, other, PackConfig(), False, lambda *c: calls.append(c), 2)

    assert contents(other) == contents(out)
    assert calls[-1] == (NUM_FILES, 2 * NUM_FILES)


def test_a_bad_record_in_a_worker_ends_a_strict_run(paths, out):
    spoil(paths[3])

    with pytest.raises(RecordError, match=r"3.tfrecord, record 1: "):
        prepare.prepare(paths, out, PackConfig(), strict=True, num_workers=2)

    assert not out.exists()


def test_generated_scenarios_are_dealt_out_to_shards(out, monkeypatch):
    monkeypatch.setattr(prepare, "SHARD_SEEDS", 3)
    monkeypatch.setattr(prepare, "FEW_SHARDS", 1)
    calls = []

    prepare.prepare(
        [range(5, 12)], out, PackConfig(), False, lambda *c: calls.append(c)
    )

    seeds = [int(one.scenario_id.split("-")[1]) for one in store.read(out)]
    assert seeds == list(range(5, 12))
    assert len(store.shard_paths(out)) == 3
    assert calls == sorted(calls) and calls[-1] == (7, 7)


def test_the_manifest_counts_what_is_in_the_store(paths, out, tmp_path):
    document = files.json_document(files.scenario(77))
    (tmp_path / "one.json").write_bytes(orjson.dumps(document))

    prepare.prepare([*paths, tmp_path / "one.json"], out, PackConfig())

    manifest = store.read_manifest(out)
    assert manifest["datasets"] == {"womd_scenario": 2 * NUM_FILES, "womd_json": 1}
    assert sum(manifest["route_sources"].values()) == 2 * NUM_FILES + 1
    assert manifest["pack"]["timeline"]["other_rates"] == "resample"
    entries = store.entries(out)
    assert [entry.scenario_id for entry in entries] == [
        packed.scenario_id for packed in store.read(out)
    ]


KILLED = """
import pathlib, sys
from drivetrain.sim.data import prepare
from drivetrain.sim.data.pack import PackConfig

if __name__ == "__main__":
    prepare.SHARD_BYTES = 1
    *paths, out = map(pathlib.Path, sys.argv[1:])
    print("begins", flush=True)
    prepare.prepare(paths, out, PackConfig(), num_workers=1)
"""


def test_a_run_killed_at_any_moment_is_continued_to_the_same_bytes(paths, out):
    undisturbed = out.with_name("undisturbed")
    prepare.prepare(paths, undisturbed, PackConfig())
    draw = random.Random(0)
    num_killed = 0
    for _ in range(4):
        words = [sys.executable, "-c", KILLED, *map(str, paths), str(out)]
        process = subprocess.Popen(words, stdout=subprocess.PIPE)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(draw.uniform(0.0, 0.2))
        process.send_signal(signal.SIGKILL)
        num_killed += process.wait() == -signal.SIGKILL
        process.stdout.close()

    prepare.prepare(paths, out, PackConfig())

    assert num_killed
    found = contents(out)
    leftover = {name for name in found if name.endswith((".partial", ".part"))}
    assert {name: found[name] for name in found.keys() - leftover} == contents(
        undisturbed
    )
    assert not leftover
