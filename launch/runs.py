"""Finds what lies in the folder of a run: its config and its checkpoints."""

import pathlib
from collections.abc import Mapping
from typing import Any

from ..learners.checkpoint import Checkpoints
from . import config, locks, tables
from .experiment import Experiment
from .monitor import PREFIX

CONFIG = "config.yaml"
CHECKPOINTS = "checkpoints"
PARAMS = ".params"  # of the train state in a checkpoint
EVALUATION, VERSIONS = "evaluation", "versions"  # of the metadata of a checkpoint
NEWEST, BEST = "newest", "best"


def load(folder: pathlib.Path) -> Experiment:
    """Returns the experiment of a run's folder.

    Raises:
        FileNotFoundError: if the folder holds no run, or one without a checkpoint.
        ValueError: if its config is damaged.
    """
    require(folder)
    if not Checkpoints(folder / CHECKPOINTS).steps():
        raise FileNotFoundError(
            f"'{folder}' has no checkpoint yet; continue it with 'drivetrain train'"
        )
    return config.load(folder / CONFIG, Experiment)


def require(folder: pathlib.Path) -> None:
    """Checks that a folder is that of a run.

    Raises:
        FileNotFoundError: if it is not.
    """
    if not (folder / CONFIG).is_file():
        raise FileNotFoundError(
            f"'{folder}' is no run: {CONFIG} is missing; make one with 'drivetrain "
            "train'"
        )


def require_room(folder: pathlib.Path, experiment: Experiment) -> None:
    """Checks that an experiment can begin, or go on, in a folder.

    Raises:
        FileExistsError: if the folder holds another experiment, or no run.
        ValueError: if its config is damaged.
    """
    path = folder / CONFIG
    if not path.exists():
        if folder.exists() and not (folder.is_dir() and _is_new(folder)):
            raise FileExistsError(
                f"'{folder}' is there and no run; name a new folder with --out"
            )
        return
    there = config.load(path, Experiment)
    if there != experiment:
        changes = "; ".join(config.differences(there, experiment))
        raise FileExistsError(
            f"'{folder}' holds a run of another config: {changes}; name another folder "
            "with --out"
        )


def _is_new(folder: pathlib.Path) -> bool:
    return {path.name for path in folder.iterdir()} <= {locks.LOCK}


def checkpoints(folder: pathlib.Path, experiment: Experiment) -> Checkpoints:
    """Opens the checkpoints of a run: the newest, and the best if it says of what."""
    monitor = experiment.monitor
    if monitor is None or monitor.best_by is None:
        return Checkpoints(folder / CHECKPOINTS, experiment.keep_newest)
    column, name = tables.column(monitor.best_by), PREFIX + monitor.best_by

    def rank(metadata: Mapping[str, Any]) -> float | None:
        figure = metadata.get(EVALUATION, {}).get(name)
        return -figure if figure is not None and column.larger_is_better else figure

    return Checkpoints(
        folder / CHECKPOINTS, experiment.keep_newest, rank, monitor.keep_best
    )


def steps(folder: pathlib.Path, there: Checkpoints, choice: str) -> list[int]:
    """Returns the checkpoints that a word allows, those to be tried first in front.

    Args:
        folder: of the run.
        there: its checkpoints.
        choice: newest, best, or the number of an update.

    Raises:
        FileNotFoundError: if there is no such checkpoint.
        ValueError: if the choice is none of these words.
    """
    if choice == NEWEST:
        return there.steps()[::-1]
    if choice == BEST:
        if best := there.best():
            return best
        raise FileNotFoundError(
            f"no checkpoint of '{folder}' is known to be the best; monitor.best_by "
            "says by what, from the first update on"
        )
    if not choice.isdecimal():
        raise ValueError(
            f"a checkpoint is {NEWEST}, {BEST} or the number of an update, got "
            f"'{choice}'"
        )
    if int(choice) not in there.steps():
        listed = ", ".join(map(str, there.steps()))
        raise FileNotFoundError(
            f"'{folder}' has no checkpoint of update {int(choice):,}; it has {listed}"
        )
    return [int(choice)]
