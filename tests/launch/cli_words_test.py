"""Tests of what the commands say: which option is wrong, and what to do next."""

import pathlib

import pytest

from drivetrain.launch import cli, config, spelling
from drivetrain.launch.experiment import Experiment

TEXT = "{data: x, updates: 4, updates_per_call: 2, updates_per_checkpoint: 2}"


def test_a_value_that_cannot_be_is_told_by_its_option(
    drivetrain, capsys: pytest.CaptureFixture
) -> None:
    assert drivetrain("evaluate", "expert", "--query.min-objects", "-5") == 2
    error = " ".join(capsys.readouterr().err.split())
    assert "Error parsing query: min_objects must be at least 0, got" in error


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (["data=store"], "drivetrain evaluate r"),
        (
            ["data=womd/*.x", "split=train"],
            "drivetrain evaluate r --data 'womd/*.x' --split test",
        ),
        (
            ["data=store", "split=train", "test_share=0.25"],
            "drivetrain evaluate r --data store --split test --test-share 0.25",
        ),
    ],
)
def test_a_run_is_to_be_evaluated_on_what_it_has_not_seen(
    fields: list[str], words: str
) -> None:
    experiment = config.from_yaml(TEXT, Experiment, fields)
    assert cli._evaluation(experiment, pathlib.Path("r")) == words


def test_booleans_of_queries_are_spelt_as_in_configs() -> None:
    typed = "evaluate true --query.lights true --query.junction=false --json true"
    meant = "evaluate true --query.lights True --query.junction=False --json true"
    assert spelling.spelt(typed.split()) == meant.split()


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("train c.yaml seed=1", "train c.yaml seed=1"),
        ("train c.yaml --out r a.b=1 seed=2", "train --out r c.yaml a.b=1 seed=2"),
        ("train c.yaml --out seed=1", "train --out seed=1 c.yaml"),
        ("train --debug-nans c.yaml a=1", "train --debug-nans c.yaml a=1"),
        ("train c.yaml --out=r a=1", "train --out=r c.yaml a=1"),
        ("prepare --out r a=1", "prepare --out r a=1"),
    ],
)
def test_fields_may_stand_after_options(typed: str, meant: str) -> None:
    assert spelling.spelt(typed.split()) == meant.split()


@pytest.mark.parametrize(("per_page", "is_told"), [(4, False), (6, True)])
def test_pages_that_are_never_exchanged_are_told(
    per_page: int, is_told: bool, capsys: pytest.CaptureFixture
) -> None:
    stream = f"stream={{resident: 8, updates_per_page: {per_page}}}"
    cli._warn_of_pages(config.from_yaml(TEXT, Experiment, [stream]))
    assert ("no page will be exchanged" in capsys.readouterr().err) == is_told


def test_a_bank_that_stays_has_no_pages(capsys: pytest.CaptureFixture) -> None:
    cli._warn_of_pages(config.from_yaml(TEXT, Experiment))
    assert capsys.readouterr().err == ""
