"""Tests that recorded actions are played again exactly, and that others are refused."""

import json
import pathlib

import numpy as np
import pytest

from drivetrain.launch import actions
from drivetrain.launch.actions import Record
from drivetrain.sim.data.synthetic import generate as synthetic

SEEDS = (2, 3, 4)
WORDS = ("--data", "synthetic:2:3", "--max-objects", "6", "--sim-agent", "idm")
# The sum of 80 steps of at most 3 m in float32; a step too late would make a metre.
ROUNDING = 1e-3  # metres


def dumped(folder: pathlib.Path) -> dict[str, np.ndarray]:
    """Returns all arrays of a dump."""
    arrays = {}
    for path in sorted(folder.iterdir()):
        with np.load(path) as archive:
            arrays |= {f"{path.stem}/{name}": archive[name] for name in archive.files}
    return arrays


def test_a_record_is_played_again_to_the_last_bit(
    drivetrain, tmp_path: pathlib.Path
) -> None:
    words = (*WORDS, "--record", "a.npz", "--json", "1.json", "--dump", "1")
    assert drivetrain("evaluate", "expert", "--dynamics", "delta", *words) == 0
    words = (*WORDS, "--actions", "a.npz", "--json", "2.json", "--dump", "2")
    assert drivetrain("evaluate", "recorded", *words) == 0

    (first,), (again,) = (
        json.loads((tmp_path / f"{run}.json").read_text()) for run in (1, 2)
    )
    assert first.pop("agent") == "expert" and again.pop("agent") == "recorded"
    assert first == again
    wanted = {"data": "synthetic:2:3", "max_objects": 6, "dynamics": "delta"}
    assert first.items() >= wanted.items()
    done, same = dumped(tmp_path / "1"), dumped(tmp_path / "2")
    assert len(done) > 30 and done.keys() == same.keys()
    for name, array in done.items():
        np.testing.assert_array_equal(array, same[name])
    # The expert's actions lead along the log: each was taken at its own step.
    assert first["log_ade_m"] < ROUNDING


def record_of(**fields) -> Record:
    """Returns a record of the generated scenarios."""
    whole = {
        "scenario_ids": tuple(synthetic.generate(seed).scenario_id for seed in SEEDS),
        "dynamics": "bicycle",
        "sim_agent": "idm",
        "num_objects": 6,
        "quantized": True,
        "actions": np.zeros((len(SEEDS), 80, 2), np.float32),
    }
    return Record(**(whole | fields))


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            "--actions text.npz",
            "'text.npz' is no record of actions, or is damaged; make one with",
        ),
        ("--actions array.npy", "'array.npy' is no record of actions"),
        ("--actions pickle.npz", "'pickle.npz' is no record of actions"),
        ("--actions other.npz", "'other.npz' is no record of actions"),
        (
            "--actions damaged.npz",
            "'damaged.npz' is no record of actions, or is damaged",
        ),
        (
            "--actions nan.npz",
            "in scenario 'synthetic-000003-junction' from step 7 on; record it",
        ),
        ("--actions absent.npz", "No such file or directory: 'absent.npz'"),
        ("--actions shape.npz", "holds actions of shape (3, 80, 3) and type float"),
        (
            "--actions good.npz --max-scenarios 2",
            "was recorded on other data: it has 3 scenarios, not 2",
        ),
        ("--actions swapped.npz", "as number 0; give the --data"),
        ("--actions short.npz", "it has 79 steps, not 80"),
        (
            "--actions good.npz --dynamics delta",
            "'good.npz' was recorded with --dynamics bicycle, not delta; leave the",
        ),
        ("", "got the agent 'recorded' without --actions"),
    ],
)
def test_what_cannot_be_played_again_is_told_in_one_sentence(
    drivetrain,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture,
    words: str,
    sentence: str,
) -> None:
    good = record_of()
    (tmp_path / "text.npz").write_text("no archive")
    np.save(tmp_path / "array.npy", good.actions)
    pickled = {"scenario_id": np.array([{}], dtype=object)}
    np.savez(tmp_path / "pickle.npz", **pickled)
    np.savez(tmp_path / "other.npz", xy=np.zeros(2))
    first, second, third = good.scenario_ids
    unsteady = good.actions.copy()
    unsteady[1, 7:] = np.nan
    for name, record in {
        "good": good,
        "shape": record_of(actions=np.zeros((3, 80, 3), np.float32)),
        "swapped": record_of(scenario_ids=(second, first, third)),
        "short": record_of(actions=good.actions[:, 1:]),
        "nan": record_of(actions=unsteady),
    }.items():
        actions.write(tmp_path / f"{name}.npz", record)
    damaged = bytearray((tmp_path / "good.npz").read_bytes())
    # Amid the actions, which the checksum of the file guards.
    damaged[damaged.find(b"actions.npy") + 40] ^= 0xFF
    (tmp_path / "damaged.npz").write_bytes(damaged)
    assert drivetrain("evaluate", "recorded", *WORDS, *words.split()) == 2
    error = capsys.readouterr().err
    assert sentence in error and "Traceback" not in error


def test_what_was_otherwise_when_recorded_is_told(
    drivetrain, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture
) -> None:
    actions.write(tmp_path / "good.npz", record_of(num_objects=4))
    words = ("--data", "synthetic:2:3", "--max-objects", "6", "--no-quantize")
    assert drivetrain("evaluate", "recorded", "--actions", "good.npz", *words) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "--sim-agent playback, not idm, --max-objects 6, not 4" in told
    assert "--quantize False, not True" in told


def test_actions_of_another_agent_are_refused(
    drivetrain, capsys: pytest.CaptureFixture
) -> None:
    assert drivetrain("evaluate", "idm", "--actions", "a.npz") == 2
    assert "got the agent 'idm' with --actions a.npz" in capsys.readouterr().err
