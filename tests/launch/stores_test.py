"""Tests of the commands that say what is in data."""

import dataclasses
import json
import pathlib

import numpy as np
import orjson
import pytest

from drivetrain.launch import comparison, stores, summary
from drivetrain.sim.data import prepare as preparing, store
from drivetrain.sim.data.entry import Entry
from tests.sim.data import files

NUM_SEEDS = 12


@pytest.fixture
def entries(drivetrain, tmp_path: pathlib.Path) -> list[Entry]:
    assert drivetrain("prepare", f"synthetic:0:{NUM_SEEDS}", "store") == 0
    return store.entries(tmp_path / "store")


def test_a_summary_counts_what_is_in_the_store(
    drivetrain, entries, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    words = ["data", "summary", "store", "--json", "out.json", "--plot", "out.png"]
    assert drivetrain(*words) == 0
    found = json.loads((tmp_path / "out.json").read_text())
    packed = list(store.read(tmp_path / "store"))
    assert found["scenarios"] == NUM_SEEDS
    (row,) = found["datasets"]
    assert row["dataset"] == "synthetic" and row["steps"] == [91, 91]
    assert row["objects"] == sum(len(one.object_id) for one in packed)
    assert row["vertices"] == sum(len(one.vertices) for one in packed)
    mean = np.mean([entry.num_bytes for entry in entries])
    assert found["bytes_per_scenario_mean"] == pytest.approx(mean)
    assert found["womd_training_gb"] == pytest.approx(mean * 487_000 / 1e9)
    speeds = [entry.ego_speed for entry in entries]
    assert found["distributions"]["ego_speed"]["p50"] == np.median(speeds)
    assert found["shares"]["lights"] == np.mean([e.num_lights > 0 for e in entries])
    out = capsys.readouterr().out
    assert "[m/s]" in out and "487,000 training scenarios, as WOMD" in " ".join(
        out.split()
    )
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


def test_lights_out_of_step_are_named(entries) -> None:
    odd, even = entries[:2]
    odd = dataclasses.replace(odd, red_crossings=3, green_crossings=1)
    even = dataclasses.replace(even, red_crossings=1, green_crossings=0)
    assert summary.suspicious_lights([odd, even]) == [odd.scenario_id]
    said = " ".join(summary.lines(summary.summarize([odd, even])))
    assert "1 scenario(s) whose lights look out of step" in said


def test_a_source_is_at_no_distance_from_itself(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    words = ["synthetic:0:4", "synthetic:0:4", "--json", "out.json", "--plot", "o.png"]
    with pytest.raises(ValueError, match="names two sources that differ"):
        comparison.compare({"one": {}})
    assert drivetrain("data", "compare", *words) == 2
    said = capsys.readouterr().err
    assert "names two sources that differ" in said and "reading" not in said
    words[1] = "synthetic:1:4"
    assert drivetrain("data", "compare", *words) == 0
    rows = json.loads((tmp_path / "out.json").read_text())
    assert {row["first"] for row in rows} == {"synthetic:0:4"}
    assert all(0 <= row["distance"] <= 1 for row in rows if row["first_samples"])
    assert (tmp_path / "o.png").read_bytes().startswith(b"\x89PNG")


def test_what_is_no_store_is_named(drivetrain, capsys: pytest.CaptureFixture) -> None:
    assert drivetrain("data", "summary", "nowhere") == 2
    assert "no store at 'nowhere'" in capsys.readouterr().err


def test_a_file_is_no_store_and_no_folder(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "README.md").write_text("words")
    assert drivetrain("data", "summary", "README.md") == 2
    said = capsys.readouterr().err
    assert "'README.md' is a file, and a store is a folder" in " ".join(said.split())


def json_file(path: pathlib.Path, seed: int = 0, **changes: str) -> None:
    """Writes a WOMD JSON file of one scenario."""
    document = files.json_document(files.scenario(seed)) | changes
    path.write_bytes(orjson.dumps(document))


def test_a_summary_says_how_the_store_was_made(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    for name in ("a.json", "b.json"):
        json_file(tmp_path / name, scenario_id="twin")
    (tmp_path / "c.json").write_text("{}")
    assert drivetrain("prepare", "*.json", "store", "--simplify", "0.05") == 0
    capsys.readouterr()

    assert drivetrain("data", "summary", "store", "--json", "out.json") == 0

    said = " ".join(capsys.readouterr().out.split())
    assert "map lines simplified to 5 cm, current step as each format has it" in said
    assert "1 record(s) were left out: 1 x there is no list 'objects'." in said
    assert "1 scenario id(s) came more than once: twin" in said
    assert "Assumed in 2 scenario(s): lane links from lane ends" in said
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["left_out"] == 1 and found["repeated_ids"] == ["twin"]
    assert found["settings"]["simplify"] == 0.05 and found["settings"]["quantize"]


def test_a_summary_verifies_the_shards_if_asked(
    drivetrain, entries, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    assert drivetrain("data", "summary", "store", "--verify") == 0
    (shard, *_) = sorted((tmp_path / "store").glob("*.array_record"))
    shard.write_bytes(shard.read_bytes()[:-1] + b"?")
    assert drivetrain("data", "summary", "store") == 0
    assert drivetrain("data", "summary", "store", "--verify") == 2
    assert f"shard '{shard.name}' of the store 'store'" in capsys.readouterr().err


def test_many_records_left_out_are_counted_and_ten_named(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    json_file(tmp_path / "good.json")
    for number in range(12):
        (tmp_path / f"{number}.txt").write_text(f"{number} is no log")
    assert drivetrain("prepare", "good.json", "*.txt", "store") == 0
    out = capsys.readouterr().out
    assert "1 scenario in 1 shard in store" in out
    assert "12 x no known format" in out
    assert out.count(", record 0: ") == 10 and "and 2 more" in out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["prepare", "a.json", "*.json"], "'*.json' names scenarios, not the folder"),
        (["prepare", "a.json", "synthetic:0:4"], "not the folder of a store"),
        (["prepare", "folder", "out"], "is a folder; give a quoted pattern"),
        (["prepare", "folder", "out"], "such as 'folder/*'"),
        (["prepare", "made", "out"], "'made' is a store already"),
        (["data", "summary", "*.json"], "drivetrain prepare '*.json' STORE"),
        (["data", "summary", "synthetic:0:2"], "drivetrain prepare 'synthetic:0:2' S"),
        (
            ["data", "summary", "made", "--plot", "p.txt"],
            "writes a PNG; name it 'p.png",
        ),
        (["data", "compare", "a.json", "none.json"], "no file matches 'none.json'"),
        (["prepare", "synthetic:0:4", "out", "--simplify", "100"], "simplify must be"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_the_work(
    drivetrain,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture,
    words: list[str],
    sentence: str,
) -> None:
    json_file(tmp_path / "a.json")
    (tmp_path / "folder").mkdir()
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "manifest.json").write_text("{}")
    assert drivetrain(*words) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert sentence in error and "reading" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("dropped", "is_told"), [(0, False), (1, False), (2, True)])
def test_candidates_left_out_are_told_from_a_thousandth_on(
    tmp_path: pathlib.Path, capsys, dropped: int, is_told: bool
) -> None:
    made = preparing.Summary(
        num_scenarios=1,
        num_shards=1,
        num_continued=0,
        num_bytes=1000,
        num_coarse=0,
        share_index_dropped=dropped / 2000,
        bad=[],
        duplicates=[],
    )
    stores._print_summary(made, tmp_path)
    said = capsys.readouterr().out
    assert ("0.1 % of the candidates for the nearest road edge" in said) == is_told
