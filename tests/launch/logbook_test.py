"""Tests that a logbook keeps what was measured, through kills and resumption."""

import json
import pathlib
import struct
import subprocess
import sys

import numpy as np
import pytest
from tensorboardX.proto import event_pb2

from drivetrain.launch import logbook


def write_steps(folder: pathlib.Path, steps: range, resume_step: int | None) -> None:
    """Logs a number for each step."""
    with logbook.Logbook(folder, resume_step=resume_step) as log:
        for step in steps:
            log.write(step, {"loss": step / 3})


def test_what_was_written_is_read_back(tmp_path: pathlib.Path) -> None:
    with logbook.Logbook(tmp_path) as log:
        log.write(0, {"loss": 0.25, "count": 3})
        log.write(10, {"loss": np.float32(0.5), "return": np.ones((1,))})
    assert logbook.read(tmp_path) == [
        {"step": 0, "loss": 0.25, "count": 3},
        {"step": 10, "loss": 0.5, "return": 1.0},
    ]


def test_a_line_is_on_disk_before_the_logbook_closes(tmp_path: pathlib.Path) -> None:
    log = logbook.Logbook(tmp_path)
    log.write(1, {"loss": 1.0})
    assert logbook.read(tmp_path) == [{"step": 1, "loss": 1.0}]
    log.close()


def test_a_number_that_is_not_finite_stays_strict_json(
    tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture
) -> None:
    with logbook.Logbook(tmp_path) as log:
        log.write(1, {"loss": float("nan"), "value": np.inf})
    text = (tmp_path / logbook.METRICS).read_text()
    assert json.loads(text, parse_constant=pytest.fail) == {
        "step": 1,
        "loss": None,
        "value": None,
    }
    assert not caplog.records


def test_a_resumed_log_equals_one_that_was_not_cut(tmp_path: pathlib.Path) -> None:
    write_steps(tmp_path / "whole", range(0, 20), None)
    write_steps(tmp_path / "cut", range(0, 14), None)
    with (tmp_path / "cut" / logbook.METRICS).open("a") as file:
        file.write('{"step": 14, "lo')
    write_steps(tmp_path / "cut", range(11, 20), 10)
    whole, cut = (
        (tmp_path / name / logbook.METRICS).read_bytes() for name in ("whole", "cut")
    )
    assert whole == cut


def test_a_new_run_leaves_the_log_of_another_alone(tmp_path: pathlib.Path) -> None:
    write_steps(tmp_path, range(3), None)
    with pytest.raises(FileExistsError, match="holds the log of another run"):
        logbook.Logbook(tmp_path)
    assert len(logbook.read(tmp_path)) == 3


@pytest.mark.parametrize("scalars", [{"loss": np.ones(2)}, {"step": 1.0}])
def test_what_is_no_single_number_is_refused(
    tmp_path: pathlib.Path, scalars: dict[str, object]
) -> None:
    with (
        logbook.Logbook(tmp_path) as log,
        pytest.raises(ValueError, match="one number a name"),
    ):
        log.write(0, scalars)


def events_of(path: pathlib.Path) -> list[event_pb2.Event]:
    """Reads an event file: length, its CRC, the event, its CRC, and so on."""
    data, events = path.read_bytes(), []
    while data:
        (length,) = struct.unpack("<Q", data[:8])
        events.append(event_pb2.Event.FromString(data[12 : 12 + length]))
        data = data[16 + length :]
    return events


def test_tensorboard_gets_what_is_finite(tmp_path: pathlib.Path) -> None:
    with logbook.Logbook(tmp_path) as log:
        log.write(7, {"loss": 0.5, "value": float("nan")})
    (path,) = tmp_path.glob("events.*")
    scalars = [
        (event.step, value.tag, value.simple_value)
        for event in events_of(path)
        for value in event.summary.value
    ]
    assert scalars == [(7, "loss", 0.5)]


def test_tensorboard_is_told_from_where_a_run_resumes(tmp_path: pathlib.Path) -> None:
    write_steps(tmp_path, range(3), None)
    write_steps(tmp_path, range(2, 3), 1)
    (path,) = tmp_path.glob("events.*.from1")
    starts = [
        event.step
        for event in events_of(path)
        if event.session_log.status == event_pb2.SessionLog.START
    ]
    assert starts == [2]
    assert len([*tmp_path.glob("events.*")]) == 2


def test_logging_imports_no_other_framework() -> None:
    code = (
        "import sys, drivetrain.launch.logbook; "
        "assert not {'torch', 'tensorflow'} & {*sys.modules}"
    )
    run = subprocess.run([sys.executable, "-W", "error", "-c", code], check=False)
    assert run.returncode == 0
