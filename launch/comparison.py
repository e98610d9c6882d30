"""Sets the traffic of one source of scenarios beside that of another."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich import box, table as rich_table, text

from ..sim.data import statistics
from ..sim.data.statistics import QUANTITIES, Samples
from . import histograms

Named = Mapping[str, Samples]  # samples by the name of their source


def require_two(names: Sequence[str]) -> None:
    """Checks that there are two sources to compare, before they are loaded.

    Raises:
        ValueError: if not.
    """
    if len(set(names)) != 2:
        raise ValueError(
            f"a comparison names two sources that differ, got {', '.join(names)}."
        )


def compare(sources: Named) -> list[dict[str, Any]]:
    """Returns a row for each quantity: how many, medians, means and their distance.

    Args:
        sources: two of them.

    Raises:
        ValueError: if there are not two.
    """
    require_two(tuple(sources))
    one, other = sources
    rows = []
    for quantity in QUANTITIES:
        row: dict[str, Any] = {"quantity": quantity}
        for label, name in (("first", one), ("second", other)):
            found = sources[name][quantity]
            row |= {
                f"{label}": name,
                f"{label}_samples": len(found),
                f"{label}_mean": float(found.mean()) if len(found) else None,
                f"{label}_median": float(np.median(found)) if len(found) else None,
            }
        row["distance"] = statistics.distance(
            sources[one][quantity], sources[other][quantity]
        )
        rows.append(row)
    return rows


def table(rows: list[dict[str, Any]]) -> rich_table.Table:
    """Makes the table for a terminal."""
    first, second = rows[0]["first"], rows[0]["second"]
    made = rich_table.Table(
        box=box.SIMPLE_HEAD,
        caption=f"A: {first}; B: {second}. Distance: the greatest difference of the "
        "distribution functions, 0 to 1 (Kolmogorov and Smirnov).",
        caption_justify="left",
    )
    made.add_column("Quantity")
    for title in ("A mean", "B mean", "A median", "B median", "Distance"):
        made.add_column(title, justify="right")
    for row in rows:
        numbers = (
            row[f"{label}_{kind}"]
            for kind in ("mean", "median")
            for label in ("first", "second")
        )
        made.add_row(
            text.Text(QUANTITIES[row["quantity"]]),
            *("" if number is None else f"{number:.2f}" for number in numbers),
            f"{row['distance']:.2f}",
        )
    return made


def draw(sources: Named, rows: list[dict[str, Any]]) -> bytes:
    """Draws the distributions of both beside each other, as a PNG."""
    panels = {
        title: {name: samples[quantity] for name, samples in sources.items()}
        for quantity, title in QUANTITIES.items()
    }
    notes = {
        QUANTITIES[row["quantity"]]: f"distance {row['distance']:.2f}" for row in rows
    }
    return histograms.draw(panels, notes)
