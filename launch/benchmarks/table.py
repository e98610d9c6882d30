"""Shows the rows of a benchmark as a table for a terminal."""

from collections.abc import Mapping, Sequence

from rich import box, table as rich_table, text

from .. import tables
from .base import Benchmark, Column

WIDE = 100  # characters of a line from which extra columns have a place
MEDIANS = "Times and rates are medians over calls, with quartiles."


def figure(value: str | int | float | None) -> str:
    """Returns a number in at least three digits; empty where there is none.

    >>> [figure(x) for x in (0.0123, 4.5, 67.89, 1234.5)]
    ['0.012', '4.50', '67.9', '1234']
    """
    if value is None:
        return ""
    number = float(value)
    decimals = next((d for d, top in ((3, 1), (2, 10), (1, 100)) if number < top), 0)
    return f"{number:.{decimals}f}"


def _short(number: str) -> str:
    """Leaves out the zero before the point, so that a spread fits its column."""
    return number.removeprefix("0") if number.startswith("0.") else number


def _cell(row: tables.Row, column: Column, paper: str) -> text.Text:
    """Returns a figure; under it its quartiles, and the paper's where it has one."""

    def of(suffix: str) -> str:
        value = row.get(column.key + suffix)
        return figure(None if value is None else column.scale * float(value))

    lower, upper, published = of("_q1"), of("_q3"), of("_published")
    below = [f"{_short(lower)}\N{EN DASH}{_short(upper)}"] if lower else []
    below += [f"{paper} {published}"] if published else []
    return text.Text(of("")).append("".join(f"\n{line}" for line in below), "dim")


def terminal(
    benchmark: Benchmark,
    rows: Sequence[tables.Row],
    facts: Mapping[str, str],
    width: int,
) -> rich_table.Table:
    """Makes the table.

    Args:
        benchmark: whose rows they are.
        rows: its figures.
        facts: what they depend on, by name.
        width: characters of a line.
    """
    columns = [c for c in benchmark.columns if width >= WIDE or not c.is_extra]
    lines = [f"{name}: {fact}" for name, fact in facts.items()]
    table = rich_table.Table(
        title=text.Text(benchmark.title),
        title_justify="left",
        caption=text.Text("\n".join([*lines, MEDIANS, *benchmark.notes])),
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=0,
    )
    table.add_column("Env\nbatch", no_wrap=True)
    table.add_column("Objects\nvalid", justify="right")
    for column in columns:
        table.add_column(
            f"{column.title}\n{column.unit}", justify="right", overflow="fold"
        )
    for row in rows:
        table.add_row(
            text.Text(str(row["env"])).append(f"\n{row['batch']}", "dim"),
            text.Text(str(row["objects"])).append(
                f"\n{float(row['valid_objects'] or 0):.1f}", "dim"
            ),
            *(_cell(row, column, benchmark.paper) for column in columns),
        )
    return table
