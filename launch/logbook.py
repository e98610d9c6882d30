"""Keeps the logbook of a run: its scalars by step, on disk.

They go to `metrics.jsonl`, one object a line, and to TensorBoard's event files.
"""

import json
import math
import os
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import tensorboardX

METRICS = "metrics.jsonl"
FLUSH_SECONDS = 10  # what a killed run may lack in TensorBoard


class Logbook:
    """The scalars of one run, by step.

    No wall-clock time is written, so that a run cut and resumed leaves the same lines
    as one that was not. A line has left the process when `write` returns, so a kill
    costs none. Only one process of a run keeps a logbook.
    """

    def __init__(
        self, folder: str | os.PathLike[str], *, resume_step: int | None = None
    ) -> None:
        """Opens the logbook in a folder, which is made where there is none.

        Args:
            folder: the folder of the run.
            resume_step: the step of the restored checkpoint; later lines are cut away.
                None starts a new logbook.

        Raises:
            FileExistsError: if a new logbook would continue another run's.
        """
        path = pathlib.Path(folder) / METRICS
        path.parent.mkdir(parents=True, exist_ok=True)
        if resume_step is not None:
            _cut(path, resume_step)
        elif path.exists() and path.stat().st_size:
            raise FileExistsError(
                f"{path} holds the log of another run; resume that run, or give this "
                "one a folder of its own"
            )
        self._lines = path.open("a", encoding="utf-8")
        is_new = resume_step is None
        self._events = tensorboardX.SummaryWriter(
            os.fspath(folder),
            purge_step=None if is_new else resume_step + 1,
            # Event files are named by the second: a quick restart must not overwrite.
            filename_suffix="" if is_new else f".from{resume_step}",
            flush_secs=FLUSH_SECONDS,
        )

    def write(self, step: int, scalars: Mapping[str, Any]) -> None:
        """Writes what was measured at a step.

        Args:
            step: environment or learner steps since the run began.
            scalars: numbers or arrays of one number, by name. One that is not finite is
                null in `metrics.jsonl` and absent from TensorBoard.

        Raises:
            ValueError: if a value is not a single number, or is named `step`.
        """
        line: dict[str, int | float | None] = {"step": step}
        for name, value in scalars.items():
            if np.size(value) != 1 or name in line:
                raise ValueError(
                    f"the log takes one number a name, and keeps the name step; got "
                    f"{name} of shape {np.shape(value)}"
                )
            number = np.asarray(value).item()
            line[name] = number if math.isfinite(number) else None
        self._lines.write(json.dumps(line, allow_nan=False) + "\n")
        self._lines.flush()
        for name, number in line.items():
            if number is not None and name != "step":
                self._events.add_scalar(name, number, step)

    def close(self) -> None:
        """Writes what TensorBoard's writer still holds, and closes the files."""
        self._lines.close()
        self._events.close()

    def __enter__(self) -> "Logbook":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def read(folder: str | os.PathLike[str]) -> list[dict[str, int | float | None]]:
    """Returns what a run has logged, in order, without a line that a kill cut short.

    Raises:
        FileNotFoundError: if the folder holds no log.
    """
    return [json.loads(line) for line in _whole_lines(pathlib.Path(folder) / METRICS)]


def _whole_lines(path: pathlib.Path) -> list[str]:
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return [line for line in lines if line.endswith("\n")]


def _cut(path: pathlib.Path, step: int) -> None:
    if not path.exists():
        return
    kept = [line for line in _whole_lines(path) if json.loads(line)["step"] <= step]
    part = path.with_suffix(".part")
    part.write_text("".join(kept), encoding="utf-8")
    os.replace(part, path)
