"""Tests of the commands as a user types them: what they write, and how they refuse."""

import json
import pathlib
import signal
from collections.abc import Callable

import numpy as np
import pytest

from drivetrain.launch import logbook
from tests.launch import saved

TINY = """
data: synthetic:0:4
max_objects: 12
observation:
  {name: vector, history: 1, num_objects: 2, num_road: 4, num_lights: 1, num_route: 2}
agent:
  encoder: {name: wayformer, width: 8, num_heads: 2, num_layers: 1, num_latents: 2}
  hidden_width: 8
learner: {name: bc, batch_size: 8, learning_rate: 1e-3}
updates: 4
updates_per_call: 2
updates_per_checkpoint: 2
"""


def scenario_file(path: pathlib.Path) -> pathlib.Path:
    """Writes a small WOMD JSON file: a car that drives along a road of two edges."""
    steps = range(91)
    edges = [(-5.0, 1), (5.0, -1)]  # the road lies left of an edge
    scene = {
        "name": path.name,
        "objects": [
            {
                "position": [{"x": 1.0 * t, "y": 0.0} for t in steps],
                "velocity": [{"x": 10.0, "y": 0.0} for t in steps],
                "heading": [0.0 for t in steps],
                "valid": [True for t in steps],
                "length": 4.0,
                "width": 2.0,
                "type": "vehicle",
                "goalPosition": {"x": 90.0, "y": 0.0},
            }
        ],
        "roads": [
            {
                "type": "road_edge",
                "geometry": [
                    {"x": float(x), "y": y} for x in range(-50, 200)[::direction]
                ],
            }
            for y, direction in edges
        ],
        "tl_states": {},
    }
    path.write_text(json.dumps(scene))
    return path


def test_prepare_train_evaluate_work_on_files(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    for number in range(3):
        scenario_file(tmp_path / f"scene{number}.json")
    (tmp_path / "broken.json").write_text('{"name": "x", "objects": [')
    assert drivetrain("prepare", "*.json", "store") == 0
    out = capsys.readouterr().out
    assert "3 scenarios" in out and "1 record(s) left out" in out
    assert "broken.json, record 0" in out

    (tmp_path / "tiny.yaml").write_text(TINY)
    assert drivetrain("train", "tiny.yaml", "data=store") == 0
    words = ["--data", "store", "--json", "table.json", "--dump", "dump"]
    assert drivetrain("evaluate", "runs/tiny", *words) == 0
    (row,) = json.loads((tmp_path / "table.json").read_text())
    assert row["agent"] == "tiny" and row["sim_agent"] == "playback"
    assert row["episodes"] == 3
    names = sorted(path.stem for path in (tmp_path / "dump").iterdir())
    assert names == ["scene0", "scene1", "scene2"]


def test_the_expert_has_the_figures_of_the_log(
    drivetrain, tmp_path: pathlib.Path
) -> None:
    scenario_file(tmp_path / "scene.json")
    words = ["--data", "scene.json", "--json", "table.json", "--dump", "dump"]
    assert drivetrain("evaluate", "expert", "--dynamics", "delta", *words) == 0
    (row,) = json.loads((tmp_path / "table.json").read_text())
    assert row["collision_pct"] == 0 and row["offroad_pct"] == 0
    assert row["log_ade_m"] < 0.01  # coordinates are kept to 1 cm
    assert row["progress_pct"] == pytest.approx(100, abs=0.1)

    with np.load(tmp_path / "dump" / "scene.npz") as dump:
        assert dump["xy"].shape == (91, 1, 2)
        np.testing.assert_allclose(dump["xy"][:, 0, 0], np.arange(91), atol=0.011)
        assert dump["velocity"].shape == (91, 1, 2) and dump["yaw"].shape == (91, 1)
        assert dump["valid"].all() and int(dump["ego_index"]) == 0
        assert dump["metric/offroad"].shape == (91, 1)
        assert dump["metric/progress"].shape == (91,)


class Cut(KeyboardInterrupt):
    """Somebody presses Ctrl-C."""


def cut() -> None:
    """Presses Ctrl-C, and again."""
    raise Cut


def at(
    step: int, monkeypatch: pytest.MonkeyPatch, happen: Callable[[], None] = cut
) -> None:
    """Lets something happen when a training run logs a step."""
    write = logbook.Logbook.write

    def write_and_more(log, now, scalars):
        write(log, now, scalars)
        if now == step:
            happen()

    monkeypatch.setattr(logbook.Logbook, "write", write_and_more)


def assert_same_checkpoint(a: pathlib.Path, b: pathlib.Path, step: int) -> None:
    """Checks that arrays are the same bit for bit, and what stands beside them."""
    assert saved.metadata(a, step) == saved.metadata(b, step)
    first, second = saved.arrays(a, step), saved.arrays(b, step)
    assert first.keys() == second.keys()
    assert all(first[name].tobytes() == second[name].tobytes() for name in first)


@pytest.mark.parametrize("cut_at", [2, 4], ids=["before a checkpoint", "after one"])
def test_a_run_that_was_cut_equals_one_that_was_not(
    drivetrain, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, cut_at: int
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    assert drivetrain("train", "tiny.yaml", "--out", "whole") == 0
    at(cut_at, monkeypatch)
    assert drivetrain("train", "tiny.yaml", "--out", "cut") == 130
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert drivetrain("train", "tiny.yaml", "--out", "cut") == 0

    lines = [(tmp_path / run / "metrics.jsonl").read_text() for run in ("whole", "cut")]
    assert lines[0] == lines[1]
    assert_same_checkpoint(tmp_path / "whole", tmp_path / "cut", 4)


def test_a_run_that_is_told_to_end_saves_and_goes_on_as_one_that_was_not(
    drivetrain, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    words = ("train", "tiny.yaml", "updates=6", "updates_per_checkpoint=6", "--out")
    assert drivetrain(*words, "whole") == 0
    at(2, monkeypatch, lambda: signal.raise_signal(signal.SIGTERM))
    assert drivetrain(*words, "told") == 75
    assert "saved told at update 2" in capfd.readouterr().err
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert drivetrain(*words, "told") == 0
    assert_same_checkpoint(tmp_path / "whole", tmp_path / "told", 6)


def test_a_run_on_a_stream_that_was_cut_equals_one_that_was_not(
    drivetrain, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = "stream: {resident: 6, pages: 3, updates_per_page: 2}\n"
    text = TINY.replace("updates: 4\n", "updates: 8\n") + stream
    (tmp_path / "tiny.yaml").write_text(text)
    assert drivetrain("prepare", "synthetic:0:12", "store") == 0
    train = ("train", "tiny.yaml", "data=store", "--out")
    assert drivetrain(*train, "whole") == 0
    at(6, monkeypatch)
    assert drivetrain(*train, "cut") == 130
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert drivetrain(*train, "cut") == 0

    # The metadata tell which scenarios are in the bank.
    assert_same_checkpoint(tmp_path / "whole", tmp_path / "cut", 8)
    lines = (tmp_path / "whole" / "metrics.jsonl").read_text().splitlines()
    assert all("page_stall_ms" in json.loads(line) for line in lines)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["evaluate", "exprt"], "unknown agent 'exprt'; did you mean 'expert'?"),
        (["evaluate", "expert", "--data", "nowhere/*.x"], "no file matches"),
        (["evaluate", "expert", "--data", "empty"], "is a folder that holds no store"),
        (["evaluate", "empty"], "'empty' is no run"),
        (["evaluate", "expert", "--data", "synthetic:a:1"], "is no source"),
        (["evaluate", "expert", "--data", "text.txt"], "no usable scenario"),
        (["prepare", "text.txt", "out"], "no usable scenario"),
        (["prepare", "text.txt"], "the folder of the store"),
        (["prepare", "text.txt", "full"], "is there and no store"),
        (["train", "tiny.yaml", "lerner.batch_size=3"], "did you mean"),
        (["train", "tiny.yaml", "updates=5"], "multiple of updates_per_call"),
        (["train", "tiny.yaml", "observation.radius=-1"], "radius must be"),
        (["train", "tiny.yaml", "learner.learning_rate=inf"], "must be positive"),
        (["evaluate", "expert", "--max-objects", "0"], "max_objects must be"),
        (["evaluate", "expert", "--max-scenarios", "0"], "max_scenarios must be"),
        (["evaluate", "expert", "--seed", "-1"], "seed must be"),
        (["train", "tiny.yaml", "dynamics=bicycel"], "did you mean 'bicycle'?"),
        (["train", "tiny.yaml", "data=missing"], "no file matches 'missing'"),
        (["train", "tiny.yaml", "--out", "full"], "is there and no run"),
        (["evaluate", "expert", "--json", "full"], "is a folder"),
        (["evaluate", "expert", "--json", "text.txt/a.json"], "text.txt' is no folder"),
        (["evaluate", "expert", "--dump", "text.txt"], "is a file; name a folder"),
        (["benchmark", "--json", "/proc/a.json"], "'/proc' may not be written to"),
        (["benchmark", "--objects", "100000"], "objects must be from 1 to 65,536"),
        (["train", "tinny.yaml"], "tiny.yaml"),
        (["train", "tiny.yaml", "learner.learning_rate=fast"], "learning_rate"),
    ],
)
def test_bad_input_ends_in_one_sentence_and_exit_code_2(
    drivetrain,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture,
    words: list[str],
    sentence: str,
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    (tmp_path / "text.txt").write_text("no driving log")
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("do not lose")
    before = sorted(tmp_path.rglob("*"))
    assert drivetrain(*words) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error
    assert len(error.splitlines()) <= 2 and "Traceback" not in error
    assert sorted(tmp_path.rglob("*")) == before


def test_a_strict_prepare_stops_at_the_first_bad_record(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    scenario_file(tmp_path / "good.json")
    (tmp_path / "bad.json").write_text("{}")
    assert drivetrain("prepare", "*.json", "store", "--strict") == 2
    assert "bad.json, record 0" in capsys.readouterr().err
    assert not (tmp_path / "store").exists()


def test_an_id_from_a_file_cannot_lead_out_of_the_dump(
    drivetrain, tmp_path: pathlib.Path
) -> None:
    path = scenario_file(tmp_path / "scene.json")
    scene = json.loads(path.read_text()) | {"scenario_id": "../../escaped"}
    path.write_text(json.dumps(scene))
    assert drivetrain("evaluate", "coast", "--data", "scene.json", "--dump", "d") == 0
    assert [p.name for p in (tmp_path / "d").iterdir()] == ["..%2F..%2Fescaped.npz"]


def test_a_run_does_not_go_on_with_other_data(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    scenario_file(tmp_path / "scene0.json")
    words = ["train", "tiny.yaml", "data=scene*.json", "--out", "run"]
    assert drivetrain(*words) == 0
    scenario_file(tmp_path / "scene1.json")
    assert drivetrain(*words) == 2
    assert "other scenarios" in capsys.readouterr().err


def test_brackets_in_a_file_are_no_markup(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    path = scenario_file(tmp_path / "bad.json")
    scene = json.loads(path.read_text())
    scene["roads"][0]["type"] = "[/red]"
    path.write_text(json.dumps(scene))
    scenario_file(tmp_path / "[good].json")
    assert drivetrain("prepare", "bad.json", "[[]good].json", "store") == 0
    assert "[/red]" in capsys.readouterr().out


def test_scenarios_with_one_id_are_all_dumped(
    drivetrain, tmp_path: pathlib.Path
) -> None:
    for name in ("a", "b"):
        path = scenario_file(tmp_path / f"{name}.json")
        scene = json.loads(path.read_text()) | {"scenario_id": "twin"}
        path.write_text(json.dumps(scene))
    words = ["--data", "[ab].json", "--dump", "d"]
    assert drivetrain("evaluate", "coast", *words) == 0
    assert sorted(p.name for p in (tmp_path / "d").iterdir()) == [
        "twin.2.npz",
        "twin.npz",
    ]


@pytest.mark.parametrize("place", [5e4, 5e6], ids=["far", "very far"])
def test_a_place_that_jumps_makes_a_bad_record(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture, place: float
) -> None:
    path = scenario_file(tmp_path / "jump.json")
    scene = json.loads(path.read_text())
    scene["objects"][0]["position"][50]["x"] = place
    path.write_text(json.dumps(scene))
    assert drivetrain("prepare", "jump.json", "store") == 2
    assert "the scene reaches" in capsys.readouterr().err


def test_a_folder_with_another_run_is_left_alone(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    assert drivetrain("train", "tiny.yaml", "--out", "run") == 0
    config = (tmp_path / "run" / "config.yaml").read_text()
    assert drivetrain("train", "tiny.yaml", "seed=1", "--out", "run") == 2
    assert "another config" in capsys.readouterr().err
    assert (tmp_path / "run" / "config.yaml").read_text() == config
