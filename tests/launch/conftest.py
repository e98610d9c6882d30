"""Runs commands for the tests of `launch`."""

import pathlib
import sys

import pytest

from drivetrain.launch import cli


@pytest.fixture
def drivetrain(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path):
    """Runs a command in an empty folder and returns its exit code."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["drivetrain", *words])
        try:
            cli.main()
        except SystemExit as stop:
            return int(stop.code or 0)
        return 0

    return run
