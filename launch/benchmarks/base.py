"""States what a benchmark is: cells of a table, each measured by itself."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence

from .. import tables
from .scenes import Scenes
from .timing import Timing

MOST = 2**16  # worlds at once, and objects of each


@dataclasses.dataclass(frozen=True, kw_only=True)
class Settings:
    """What to measure, and on what."""

    data: str  # a store, a file, a pattern of files, or synthetic:FIRST:COUNT
    scenarios: int = 16  # of the data, those with the most objects
    objects: tuple[int, ...] = ()  # slots of a scenario; empty for the usual ones
    batches: tuple[int, ...] = ()  # worlds at once; empty for the usual ones
    sim_agent: str = "playback"  # drives what is not controlled
    seconds: float = 1.0  # of calls for each figure
    max_memory_gb: float = 4.0  # programs that need more are not run

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if nothing would be measured.
        """
        for name in ("objects", "batches"):
            numbers = getattr(self, name)
            for number in numbers:
                if not 1 <= number <= MOST:
                    raise ValueError(
                        f"{name} must be from 1 to {MOST:,}, got {number:,}."
                    )
        if self.scenarios < 1:
            raise ValueError(f"scenarios must be at least 1, got {self.scenarios}.")
        for name in ("seconds", "max_memory_gb"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(
                    f"{name} must be positive and finite, got {getattr(self, name)}."
                )


def numbers(name: str, text: str) -> tuple[int, ...]:
    """Reads whole numbers with commas between them; none from an empty text.

    Args:
        name: of the option, for the error.
        text: such as `8,16`.

    Raises:
        ValueError: if something between the commas is no whole number.
    """
    words = text.split(",") if text else []
    if not all(word.strip().isdecimal() for word in words):
        raise ValueError(f"{name} must be whole numbers such as 8,16,32, got {text!r}.")
    return tuple(int(word) for word in words)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cell:
    """One row of the table before it is measured."""

    env: str
    batch: int  # worlds at once
    objects: int  # slots of each world


@dataclasses.dataclass(frozen=True, kw_only=True)
class Column:
    """One figure of the table."""

    key: str  # its name in a row
    title: str
    unit: str
    scale: float = 1.0  # from the row's figure to the unit
    is_extra: bool = False  # left out where lines are short


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plot:
    """Lines over one axis, both axes logarithmic."""

    name: str  # of the file
    x_label: str
    y_label: str
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]]  # x and y by label


@dataclasses.dataclass(frozen=True, kw_only=True)
class Benchmark:
    """What is measured of each cell, and how it is shown.

    `measure(settings, scenes, cell)` returns the figures of a row: times as medians
    `KEY` with quartiles `KEY_q1` and `KEY_q3`, and `KEY_published` where a paper has
    the figure.
    """

    title: str
    paper: str  # the letter that marks its figures
    envs: tuple[str, ...]
    batches: tuple[int, ...]  # the usual ones
    objects: tuple[int, ...]  # the usual ones
    measure: Callable[[Settings, Scenes, Cell], tables.Row]
    columns: tuple[Column, ...]
    plots: Callable[[Sequence[tables.Row]], list[Plot]]
    notes: tuple[str, ...]  # the sentences without which the table could be misread

    def cells(self, settings: Settings) -> list[Cell]:
        """Returns the rows to measure, in their order in the table."""
        return [
            Cell(env=env, batch=batch, objects=objects)
            for env, batch, objects in itertools.product(
                self.envs,
                settings.batches or self.batches,
                settings.objects or self.objects,
            )
        ]


def timed(key: str, timing: Timing, num_steps: int = 1) -> tables.Row:
    """Returns the median of a time with its quartiles, of one of several steps [ms]."""
    return {
        key: timing.median / num_steps,
        f"{key}_q1": timing.lower / num_steps,
        f"{key}_q3": timing.upper / num_steps,
    }


def rate(key: str, timing: Timing, count: float) -> tables.Row:
    """Returns how often something happens that a call does so many times [1/s]."""
    return {
        key: count / timing.median * 1e3,
        f"{key}_q1": count / timing.upper * 1e3,
        f"{key}_q3": count / timing.lower * 1e3,
    }


def plots_over_objects(
    rows: Sequence[tables.Row], figures: Iterable[tuple[str, str, str]]
) -> list[Plot]:
    """Returns figures over the number of objects, with a line for each env and batch.

    Args:
        rows: of the table.
        figures: of each plot its name, the key of the figure, and the label of its
            axis.
    """

    def label(row: tables.Row) -> str:
        return f"{row['env']}, batch {row['batch']}"

    return [
        Plot(
            name=name,
            x_label="objects",
            y_label=y_label,
            lines=lines_by(rows, label, "objects", key),
        )
        for name, key, y_label in figures
    ]


def lines_by(
    rows: Iterable[tables.Row], label: Callable[[tables.Row], str], x: str, y: str
) -> dict[str, tuple[list[float], list[float]]]:
    """Returns a line of each label through its rows, for a plot."""
    lines: dict[str, tuple[list[float], list[float]]] = {}
    for row in rows:
        places, values = lines.setdefault(label(row), ([], []))
        places.append(float(row[x] or 0))
        values.append(float(row[y] or 0))
    return lines
