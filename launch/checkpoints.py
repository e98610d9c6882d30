"""Shows the checkpoints of a run, and checks them."""

import datetime
import pathlib
from typing import Annotated

import tyro
from rich import console as rich_console, table as rich_table

from ..learners.checkpoint import Checkpoints
from . import config, runs, tables
from .experiment import Experiment
from .monitor import PREFIX
from .progress import progress

Run = Annotated[pathlib.Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]


def show(run: Run, /) -> None:
    """Lists the checkpoints of a run.

    drivetrain checkpoint list runs/small_ppo

    Those that are not finished were cut as they were saved, and those that are damaged
    were found so by a run that went on before them; neither is ever restored. Where the
    run keeps the best by a figure, that is shown too.

    Args:
        run: the folder of the run.
    """
    experiment, checkpoints = _of(run)
    monitor = experiment.monitor
    figure = None if monitor is None else monitor.best_by
    finished, best = checkpoints.steps(), checkpoints.best()[:1]
    table = rich_table.Table()
    for title in ("Update", "Size [MB]", "Devices", "Saved", "State"):
        table.add_column(title, justify="left" if title == "State" else "right")
    if figure is not None:
        column = tables.column(figure)
        table.add_column(f"{column.title} [{column.unit}]", justify="right")
    made_with: list[str] = []
    for path in checkpoints.folders():
        step, _, rest = path.name.partition(".")
        known, state = {}, rest or "not finished"
        if not rest and int(step) in finished:
            known = checkpoints.metadata_of(int(step)) or {}
            state = "finished, best" if int(step) in best else "finished"
        value = known.get(runs.EVALUATION, {}).get(f"{PREFIX}{figure}")
        table.add_row(
            f"{int(step):,}",
            f"{_num_bytes(path) / 1e6:,.1f}",
            str(known["layout"]["devices"]) if known else "-",
            f"{datetime.datetime.fromtimestamp(path.stat().st_mtime):%Y-%m-%d %H:%M}",
            state,
            *([] if figure is None else ["-" if value is None else f"{value:.2f}"]),
        )
        versions = known.get(runs.VERSIONS, {})
        made_with.append(", ".join(f"{n} {version}" for n, version in versions.items()))
    rich_console.Console(highlight=False).print(table)
    for versions in dict.fromkeys(filter(None, made_with)):
        print(f"saved with {versions}")


def verify(run: Run, /) -> None:
    """Reads every checkpoint of a run, and says whether it is what was saved.

    drivetrain checkpoint verify runs/small_ppo

    Ends with exit code 2 if one is damaged. 'sha256sum --check *.sha256' in the folder
    of the checkpoints does the same.

    Args:
        run: the folder of the run.
    """
    _, checkpoints = _of(run)
    steps = [int(path.name) for path in checkpoints.folders() if path.suffix == ""]
    wrong = []
    with progress("verifying", len(steps), unit="checkpoints") as line:
        for done, step in enumerate(steps, start=1):
            damage = checkpoints.damage(step)
            print(f"{step:,}: {damage or 'as it was saved'}")
            wrong += [f"{step:,}"] if damage else []
            line.update(done)
    if wrong:
        raise ValueError(
            f"{len(wrong)} of the {len(steps)} checkpoints of '{run}' are damaged: "
            f"{', '.join(wrong)}; "
            + (
                "bring one back from a copy, or train into another folder with --out"
                if len(wrong) == len(steps)
                else "'drivetrain train' goes on from the newest other"
            )
        )


def _of(run: pathlib.Path) -> tuple[Experiment, Checkpoints]:
    runs.require(run)
    experiment = config.load(run / runs.CONFIG, Experiment)
    checkpoints = runs.checkpoints(run, experiment)
    if not checkpoints.folders():
        raise FileNotFoundError(
            f"'{run}' has no checkpoint yet; continue it with 'drivetrain train'"
        )
    return experiment, checkpoints


def _num_bytes(folder: pathlib.Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
