"""Makes tables of results: rows out of episodes, and text out of rows.

A row is a plain dict, ready for JSON: `agent`, `sim_agent`, `episodes`, and for each
metric its value with, where known, its spread as `*_low` and `*_high` (95 % bootstrap
interval over episodes) or `*_std` (standard deviation over training seeds).
"""

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Shaped
from rich import box, console as rich_console, table as rich_table, text

from ..sim import files, names

Row = dict[str, str | int | float | None]

NUM_RESAMPLES = 1000  # puts the bounds within a twentieth of the interval's width
PERCENTILES = (2.5, 97.5)
WIDE_COLUMNS = 100  # characters from which agent and sim agent get a column each
METRIC_WIDTH = 10  # characters of a metric's column, and of half of the names'


@dataclasses.dataclass(frozen=True, kw_only=True)
class Column:
    """One metric of the table."""

    metric: str  # its name among the episode figures
    key: str  # its name in a row
    title: str
    unit: str
    scale: float  # from the episode figure to the unit
    larger_is_better: bool = False


COLUMNS = tuple(
    Column(
        metric=metric,
        key=f"{metric}_{suffix}",
        title=title,
        unit=unit,
        scale=scale,
        larger_is_better=metric in ("progress", "goal"),
    )
    for metric, title, suffix, unit, scale in (
        ("collision", "Collision", "pct", "%", 100.0),
        ("offroad", "Off-road", "pct", "%", 100.0),
        ("offroute", "Off-route", "pct", "%", 100.0),
        ("kinematic", "Kinematic", "pct", "%", 100.0),
        ("log_ade", "Log ADE", "m", "m", 1.0),
        ("progress", "Progress", "pct", "%", 100.0),
        ("wrong_way", "Wrong way", "pct", "%", 100.0),
        ("red_light", "Red light", "pct", "%", 100.0),
        ("edge_contact", "Road edge", "pct", "%", 100.0),
        ("goal", "Goal", "pct", "%", 100.0),
        ("log_fde", "Log FDE", "m", "m", 1.0),
    )
)


def summarize(
    episodes: Mapping[str, Shaped[np.ndarray, " episodes"]],
    *,
    agent: str,
    sim_agent: str,
    seed: int,
) -> Row:
    """Makes the row of one evaluation (`definitions.md` section 7).

    Rates are percentages of episodes that were flagged; displacements and progress are
    means over episodes. Where an episode has no value for a metric, the metric is the
    mean over the others, and `<metric>_episodes` says over how many. The interval is
    the percentile bootstrap (Efron & Tibshirani 1993, chapter 13) over those episodes:
    of a rate of 0 or 100 % it is a single point.

    Args:
        episodes: by metric, whether each episode was flagged, its `log_ade` and
            `log_fde` [m] or its `progress` [ratio] (see `aggregate.summarize`);
            `<metric>_mask` is False where an episode has no such value. A value that is
            not finite counts as absent.
        agent: who drove the ego.
        sim_agent: who drove the others.
        seed: of the bootstrap; stated in the row.

    Raises:
        ValueError: if there are no episodes, or the metrics differ in their number.
    """
    columns = [column for column in COLUMNS if column.metric in episodes]
    lengths = {len(episodes[column.metric]) for column in columns}
    if len(lengths) != 1 or 0 in lengths:
        raise ValueError(
            f"every metric needs one value per episode, at least one; got the lengths "
            f"{sorted(lengths)}"
        )
    row: Row = {"agent": agent, "sim_agent": sim_agent, "episodes": lengths.pop()}
    for column in columns:
        values = np.asarray(episodes[column.metric], np.float64) * column.scale
        mask = np.asarray(episodes.get(f"{column.metric}_mask", True))
        present = values[mask & np.isfinite(values)]
        row[f"{column.metric}_episodes"] = len(present)
        row[column.key] = float(present.mean()) if len(present) else None
        low, high = _interval(present, seed) if len(present) else (None, None)
        row[f"{column.key}_low"], row[f"{column.key}_high"] = low, high
    row["bootstrap_seed"] = seed
    return row


def _interval(values: np.ndarray, seed: int) -> tuple[float, float]:
    rng = np.random.default_rng(seed)
    size = len(values)
    means = [values[rng.integers(size, size=size)].mean() for _ in range(NUM_RESAMPLES)]
    low, high = np.percentile(means, PERCENTILES)
    return float(low), float(high)


def over_seeds(rows: Sequence[Row]) -> Row:
    """Joins the rows of one agent, trained with several seeds, into mean and deviation.

    Raises:
        ValueError: if the rows are of several agents, or of evaluations that differ.
    """
    same = {(row["agent"], row["sim_agent"], row["episodes"]) for row in rows}
    if len(same) != 1:
        raise ValueError(f"seeds of one agent in one evaluation are wanted, got {same}")
    agent, sim_agent, episodes = same.pop()
    joined: Row = {"agent": agent, "sim_agent": sim_agent, "episodes": episodes}
    joined["seeds"] = len(rows)
    for column in COLUMNS:
        values = [row[column.key] for row in rows if row.get(column.key) is not None]
        if values:
            numbers = np.array(values, np.float64)
            joined[column.key] = float(numbers.mean())
            if len(numbers) > 1:
                joined[f"{column.key}_std"] = float(numbers.std(ddof=1))
    return joined


def column(key: str) -> Column:
    """Returns the metric of a name in a row.

    Raises:
        ValueError: if there is none.
    """
    for column in COLUMNS:
        if column.key == key:
            return column
    raise names.unknown("figure", key, [column.key for column in COLUMNS])


def columns_of(rows: Sequence[Row]) -> tuple[Column, ...]:
    """Returns the metrics that some row has."""
    return tuple(
        column
        for column in COLUMNS
        if any(row.get(column.key) is not None for row in rows)
    )


def cell(row: Row, column: Column) -> tuple[str, str]:
    """Returns a metric's value and its spread as text; either may be empty."""
    value = row.get(column.key)
    if value is None:
        return "", ""
    low, high = row.get(f"{column.key}_low"), row.get(f"{column.key}_high")
    deviation = row.get(f"{column.key}_std")
    if deviation is not None:
        return f"{value:.2f}", f"±{deviation:.2f}"
    if low is not None and high is not None:
        return f"{value:.2f}", f"{_short(low)}\N{EN DASH}{_short(high)}"
    return f"{value:.2f}", ""


def _short(bound: float | int | str) -> str:
    """Writes a bound in at most four characters, so that a spread fits its column."""
    return f"{bound:.1f}" if abs(float(bound)) < 9.95 else f"{bound:.0f}"


def notes(rows: Sequence[Row]) -> list[str]:
    """Returns the sentences without which the table could be misread."""
    sentences = []
    if any(
        row.get(f"{column.key}_low") is not None for row in rows for column in COLUMNS
    ):
        sentences.append("Ranges are 95 % bootstrap intervals over episodes.")
    if any(
        row.get(f"{column.key}_std") is not None for row in rows for column in COLUMNS
    ):
        sentences.append("± is the standard deviation over training seeds.")
    for row in rows:
        for column in columns_of([row]):
            count = row.get(f"{column.metric}_episodes", row["episodes"])
            if count != row["episodes"]:
                sentences.append(
                    f"{column.title} of {row['agent']} with {row['sim_agent']} is over "
                    f"{count} of {row['episodes']} episodes; the others have none."
                )
    return list(dict.fromkeys(sentences))  # of several seeds the same may be said


def name_of(row: Row) -> str:
    """Returns the agent, and which of its seeds the row is of."""
    if row.get("run_seed") is not None:
        return f"{row['agent']}/seed{row['run_seed']}"
    if row.get("seeds") is not None:
        return f"{row['agent']}/mean"
    return str(row["agent"])


def terminal(rows: Sequence[Row], title: str, width: int) -> rich_console.Group:
    """Makes the table for a terminal of a width in characters, at least 80.

    Metrics that do not fit beside the others stand in a second table under the first.
    """
    is_wide = width >= WIDE_COLUMNS
    columns = columns_of(rows)
    fitting = width // METRIC_WIDTH - (4 if is_wide else 2)
    firsts = range(0, max(len(columns), 1), fitting)
    blocks = [_block(rows, columns[i : i + fitting], is_wide) for i in firsts]
    blocks[0].title = text.Text(title)  # it may name files: brackets are no markup
    blocks[-1].caption = " ".join(notes(rows)) or None
    return rich_console.Group(*blocks)


def _block(
    rows: Sequence[Row], columns: Sequence[Column], is_wide: bool
) -> rich_table.Table:
    """Makes a table of some metrics."""
    table = rich_table.Table(
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1 if is_wide else 0, 0, 0),
    )
    for header in ("Agent", "Sim agents") if is_wide else ("Agent\nsim agents",):
        table.add_column(header, overflow="fold")
    table.add_column("Episodes", justify="right", no_wrap=True)
    for column in columns:
        header = f"{column.title}\n{column.unit}"
        table.add_column(header, justify="right", no_wrap=True)
    for row in rows:
        agent, sim_agent = name_of(row), str(row["sim_agent"])
        names = (
            [text.Text(agent), text.Text(sim_agent)]
            if is_wide
            else [text.Text(agent).append(f"\n{sim_agent}", "dim")]
        )
        table.add_row(
            *names,
            f"{row['episodes']:,}",
            *(
                text.Text(value).append(f"\n{spread}", "dim")
                for value, spread in (cell(row, column) for column in columns)
            ),
        )
    return table


def show(
    rows: Sequence[Row], title: str, console: rich_console.Console | None = None
) -> None:
    """Prints the table on a terminal, or on standard output wherever that leads."""
    console = console or rich_console.Console()
    console.print(terminal(rows, title, console.width))


def write_json(path: str | os.PathLike[str], rows: Sequence[Row]) -> None:
    """Writes the rows as a JSON list, whole or not at all."""
    files.write_whole(path, json.dumps(list(rows), indent=1, allow_nan=False) + "\n")
