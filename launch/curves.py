"""Draws how runs went on learning, beside each other."""

import dataclasses
import io
import itertools
import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float
from matplotlib import axes, figure as mpl_figure, lines, ticker

from ..sim import files, names
from . import logbook, outputs, runs as folders

# Told apart by the colour-blind (Okabe and Ito 2008), and by their order.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
AXIS_COLOR = "#555555"
COLUMNS = 3
LABELS = 2  # names of runs that fit above a panel
SEED = re.compile(r"^seed\d+/")  # before what one of several seeds has logged


@dataclasses.dataclass(frozen=True, kw_only=True)
class Curve:
    """What a run measured, of each of its seeds."""

    steps: Float[np.ndarray, " points"]  # of worlds, or demonstrations
    values: Float[np.ndarray, "seeds points"]  # NaN where there was no finite value


def curves(
    runs: Annotated[
        tuple[pathlib.Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN …")
    ],
    /,
    metrics: str = "evaluation/collision_pct,evaluation/offroad_pct",
    out: pathlib.Path = pathlib.Path("runs/curves.png"),
) -> None:
    """Draws how runs went on learning: the mean of their seeds, and the range.

    drivetrain curves runs/bc runs/ppo --metrics evaluation/collision_pct,loss

    What is across is steps of worlds played, of bc and wayformer demonstrations seen.

    Args:
        runs: their folders.
        metrics: what their metrics.jsonl has, with commas between several: a panel
            each. A run that lacks one is left out of its panel.
        out: the picture, a PNG.
    """
    outputs.require({"out": out})
    wanted = [metric.strip() for metric in metrics.split(",")]
    panels = read_all(runs, wanted)
    files.write_whole(out, draw(panels))
    print(f"drawn: {out}")
    labels = [_label(run, runs) for run in runs]
    for metric, found in panels.items():
        if missing := [label for label in labels if label not in found]:
            print(f"left out of {metric}, not logged there: {', '.join(missing)}")


def read_all(
    runs: Sequence[pathlib.Path], metrics: Sequence[str]
) -> dict[str, dict[str, Curve]]:
    """Returns the curves of each metric by the names of the runs that have it.

    Raises:
        FileNotFoundError: if there is no such run.
        ValueError: if no run has a metric.
    """
    panels: dict[str, dict[str, Curve]] = {metric: {} for metric in metrics}
    for run in runs:
        for metric, curve in read(run, metrics).items():
            panels[metric][_label(run, runs)] = curve
    for metric, found in panels.items():
        if not found:
            known = sorted({name for run in runs for name in _names(run)})
            raise names.unknown("metric", metric, known)
    return panels


def _label(run: pathlib.Path, runs: Sequence[pathlib.Path]) -> str:
    """Returns the name of a run's folder, or if others have it too, its path."""
    return run.name if sum(other.name == run.name for other in runs) == 1 else str(run)


def _names(run: pathlib.Path) -> set[str]:
    """Returns what a run has logged, without what each seed has logged apart."""
    logged = {name for line in logbook.read(run) for name in line}
    return {SEED.sub("", name) for name in logged} - {"step"}


def read(run: pathlib.Path, metrics: Sequence[str]) -> dict[str, Curve]:
    """Returns the curve of each metric that a run has logged.

    Raises:
        FileNotFoundError: if there is no such run.
    """
    experiment, every = folders.load(run), logbook.read(run)
    prefixes = [""]
    if experiment.seeds > 1:
        prefixes = [f"seed{number}/" for number in range(experiment.seeds)]
    found = {}
    for metric in metrics:
        keys = [prefix + metric for prefix in prefixes]
        logged = [line for line in every if any(key in line for key in keys)]
        if logged:
            updates = np.array([line["step"] for line in logged], np.float64)
            values = [[line.get(key) for line in logged] for key in keys]
            found[metric] = Curve(
                steps=updates * experiment.learner.num_steps,
                values=np.array(values, np.float64),
            )
    return found


def draw(panels: Mapping[str, Mapping[str, Curve]]) -> bytes:
    """Draws curves as a PNG, the mean of all seeds as a line and their range as a band.

    Args:
        panels: by metric, the curve of each run by its name.
    """
    rows, columns = -(-len(panels) // COLUMNS), min(len(panels), COLUMNS)
    fig = mpl_figure.Figure(
        figsize=(4.2 * columns, 3.0 * rows + 0.4), layout="constrained", dpi=110
    )
    grid = fig.subplots(rows, columns, squeeze=False).ravel()
    every = list(dict.fromkeys(name for runs in panels.values() for name in runs))
    colors = dict(zip(every, itertools.cycle(COLORS), strict=False))
    for ax, (metric, runs) in zip(grid, panels.items(), strict=False):
        _panel(ax, metric, runs, colors)
    for ax in grid[len(panels) :]:
        ax.set_visible(False)
    fig.supxlabel("steps played, or demonstrations seen", fontsize=9)
    handles = [lines.Line2D([], [], color=color) for color in colors.values()]
    fig.legend(
        handles,
        every,
        loc="outside upper center",
        ncols=min(len(every), LABELS * columns),
        frameon=False,
        fontsize=9,
    )
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _panel(
    ax: axes.Axes, metric: str, runs: Mapping[str, Curve], colors: Mapping[str, str]
) -> None:
    for name, curve in runs.items():
        color, values = colors[name], curve.values
        ax.plot(curve.steps, values.mean(axis=0), color=color, lw=1.6)
        low, high = values.min(axis=0), values.max(axis=0)
        ax.fill_between(curve.steps, low, high, color=color, alpha=0.2, lw=0)
    ax.set_title(metric, fontsize=9)
    ax.xaxis.set_major_formatter(ticker.EngFormatter(sep=""))
    ax.tick_params(colors=AXIS_COLOR, labelsize=8)
    ax.grid(color=AXIS_COLOR, alpha=0.2, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
