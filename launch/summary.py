"""Says what is in a store: counts, distributions, bytes, and what looks suspicious."""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from rich import box, table as rich_table, text

from ..sim.data import prepare as preparing
from ..sim.data.bank import MAX_ROWS, TABLES
from ..sim.data.entry import Entry
from ..sim.data.packed import QUANTUM
from ..sim.data.query import EVERYTHING

WOMD_TRAINING = 487_000  # scenarios of the training split of WOMD
PERCENTILES = (5, 25, 50, 75, 95)
COUNTS = (
    "objects",
    "vehicles",
    "pedestrians",
    "cyclists",
    "others",
    "map_points",
    "vertices",
    "lights",
    "stop_signs",
    "paths",
)
SUSPICIOUS_RED = 2  # vehicles that pass at red, at least, and more than at green

DISTRIBUTIONS = {
    "num_steps": "steps",
    "num_objects": "objects",
    "num_still": "objects that stand",
    "ego_speed": "ego speed [m/s]",
    "ego_distance": "ego gets away [m]",
    "encounter": "encounter [s]",
    "num_map_points": "map points",
    "num_vertices": "map vertices",
    "num_edges": "road edge vertices",
    "num_lights": "lights",
    "num_stop_signs": "stop signs",
    "num_paths": "routes",
    "num_bytes": "bytes",
}
SHARES = {
    "moving_ego": "ego moves",
    "interactive": "interactive (3 s)",
    "junction": "at a junction",
    "feasible_goal": "feasible goal",
    "lights": "with lights",
}


def values(entries: Sequence[Entry], name: str) -> Float[np.ndarray, " known"]:
    """Returns one of `DISTRIBUTIONS` for each scenario that has it."""
    found = [getattr(entry, name) for entry in entries]
    return np.array([value for value in found if value is not None], np.float64)


def suspicious_lights(entries: Sequence[Entry]) -> list[str]:
    """Names the scenarios in which more vehicles pass a light at red than at green.

    About a tenth of WOMD's lights are out of step with the tracks.
    """
    return [
        entry.scenario_id
        for entry in entries
        if entry.red_crossings >= SUSPICIOUS_RED
        and entry.red_crossings > entry.green_crossings
    ]


def summarize(entries: Sequence[Entry]) -> dict[str, Any]:
    """Returns the figures of a store, as JSON can hold them.

    Args:
        entries: of all its scenarios, at least one.
    """
    num_bytes = values(entries, "num_bytes")
    shares = {
        name: sum(map(dataclasses.replace(EVERYTHING, **{name: True}).matches, entries))
        / len(entries)
        for name in SHARES
    }
    ids = Counter(entry.scenario_id for entry in entries)
    repeated = {name: count for name, count in ids.items() if count > 1}
    return {
        "scenarios": len(entries),
        "bytes_total": int(num_bytes.sum()),
        "bytes_per_scenario_mean": float(num_bytes.mean()),
        "womd_training_scenarios": WOMD_TRAINING,
        "womd_training_gb": float(num_bytes.mean()) * WOMD_TRAINING / 1e9,
        "womd_training_rows": {
            kind: round(float(np.mean([e.rows[kind] for e in entries])) * WOMD_TRAINING)
            for kind in TABLES
        },
        "datasets": [
            _dataset([entry for entry in entries if entry.dataset == name])
            for name in sorted({entry.dataset for entry in entries})
        ],
        "ego_sources": dict(Counter(entry.ego_source for entry in entries)),
        "assumptions": dict(
            Counter(word for e in entries for word in e.assumptions.split("; ") if word)
        ),
        "shares": shares,
        "distributions": {
            name: _distribution(values(entries, name)) for name in DISTRIBUTIONS
        },
        "suspicious_lights": suspicious_lights(entries),
        "repeated_ids": sorted(repeated),
        "index_dropped": sum(entry.num_index_dropped for entry in entries),
        "wider_than_655_m": sum(entry.quantum > QUANTUM for entry in entries),
    }


def _dataset(entries: Sequence[Entry]) -> dict[str, Any]:
    def total(name: str) -> int:
        return sum(getattr(entry, name) for entry in entries)

    steps = [entry.num_steps for entry in entries]
    return {
        "dataset": entries[0].dataset,
        "scenarios": len(entries),
        "steps": [min(steps), max(steps)],
        **{name: total(f"num_{name}") for name in COUNTS},
        "ego_sources": dict(Counter(entry.ego_source for entry in entries)),
        "route_sources": dict(Counter(entry.route_source for entry in entries)),
        "bytes_per_scenario_mean": float(values(entries, "num_bytes").mean()),
    }


def _distribution(found: Float[np.ndarray, " known"]) -> dict[str, Any]:
    """Returns how many there are, their percentiles and mean."""
    if not len(found):
        return {"count": 0}
    marks = np.percentile(found, PERCENTILES)
    return {
        "count": len(found),
        "mean": float(found.mean()),
        **{
            f"p{percent}": float(mark)
            for percent, mark in zip(PERCENTILES, marks, strict=True)
        },
    }


def dataset_table(figures: dict[str, Any]) -> rich_table.Table:
    """Makes the table of formats: what each one brought."""
    table = rich_table.Table(box=box.SIMPLE_HEAD)
    table.add_column("Format", no_wrap=True)
    titles = {"objects": "Objects", "map_points": "Map points", "lights": "Lights"}
    for title in ("Scenarios", "Steps", *titles.values(), "Routes"):
        table.add_column(title, justify="right", no_wrap=True)
    for row in figures["datasets"]:
        low, high = row["steps"]
        table.add_row(
            row["dataset"],
            f"{row['scenarios']:,}",
            f"{low}" if low == high else f"{low}\N{EN DASH}{high}",
            *(f"{row[name]:,}" for name in (*titles, "paths")),
        )
    return table


def distribution_table(figures: dict[str, Any]) -> rich_table.Table:
    """Makes the table of distributions over scenarios."""
    table = rich_table.Table(box=box.SIMPLE_HEAD)
    table.add_column("Of a scenario")
    for title in (*(f"{percent} %" for percent in PERCENTILES), "Mean"):
        table.add_column(title, justify="right")
    for name, title in DISTRIBUTIONS.items():
        found = figures["distributions"][name]
        keys = (*(f"p{percent}" for percent in PERCENTILES), "mean")
        cells = [_figure(found[key]) if found["count"] else "" for key in keys]
        table.add_row(text.Text(title), *cells)
    return table


def _figure(value: float) -> str:
    return f"{value:,.1f}" if abs(value) < 100 and value % 1 else f"{value:,.0f}"


def _rows_line(rows: dict[str, int]) -> str:
    """Says whether the tables of all of WOMD can be numbered on one device."""
    kind = max(rows, key=lambda kind: rows[kind])
    said = (
        f"Their longest table ({kind}) has {rows[kind] / 1e9:.2f} of the "
        f"{MAX_ROWS / 1e9:.2f} billion rows that one device can number"
    )
    if rows[kind] <= MAX_ROWS:
        return f"{said}."
    return f"{said}: they do not fit, use {-(-rows[kind] // MAX_ROWS)} devices or more."


def lines(figures: dict[str, Any]) -> list[str]:
    """Returns the sentences under the tables."""
    shares = ", ".join(
        f"{SHARES[name]} {100 * share:.0f} %"
        for name, share in figures["shares"].items()
    )
    mean = figures["bytes_per_scenario_mean"]
    said = [
        f"Scenarios: {shares}.",
        f"In the bank: {mean / 1e3:.1f} KB a scenario, "
        f"{figures['bytes_total'] / 1e6:,.1f} MB in all; at that, {WOMD_TRAINING:,} "
        f"training scenarios, as WOMD has, take {figures['womd_training_gb']:.1f} GB."
        f" {_rows_line(figures['womd_training_rows'])}",
    ]
    for row in figures["datasets"]:
        routes, egos = (
            ", ".join(f"{name} {count:,}" for name, count in row[key].items())
            for key in ("route_sources", "ego_sources")
        )
        said.append(f"{row['dataset']}: routes from {routes}; egos {egos}.")
    for word, count in figures["assumptions"].items():
        said.append(f"Assumed in {count:,} scenario(s): {word}.")
    repeated = figures["repeated_ids"]
    if repeated:
        said.append(
            f"{len(repeated)} scenario id(s) came more than once: {_some(repeated)}"
        )
    suspects = figures["suspicious_lights"]
    if suspects:
        said.append(
            f"{len(suspects)} scenario(s) whose lights look out of step with the "
            f"tracks (more pass at red than at green): {_some(suspects)}"
        )
    return said


def _some(names: Sequence[str]) -> str:
    more = " \N{HORIZONTAL ELLIPSIS}" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def preparation(
    manifest: Mapping[str, Any], bad: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Returns how a store was made, as JSON can hold it.

    Args:
        manifest: of the store.
        bad: the records that were left out, each with its reason.
    """
    return {
        "settings": manifest["pack"],
        "left_out": len(bad),
        "left_out_reasons": dict(preparing.reasons(bad)),
    }


def preparation_lines(figures: dict[str, Any]) -> list[str]:
    """Returns sentences about how a store was made."""
    settings = figures["settings"]
    timeline = settings["timeline"]
    step = timeline["current_step"]
    kept = (
        f"16-bit numbers, map lines simplified to {100 * settings['simplify']:g} cm"
        if settings["quantize"]
        else "float32 numbers, map lines not simplified"
    )
    said = [
        f"Prepared with: {kept}, current step "
        f"{'as each format has it' if step is None else step}, other rates "
        f"{timeline['other_rates']}d.",
    ]
    if figures["left_out"]:
        reasons = "; ".join(
            f"{count:,} x {reason}"
            for reason, count in figures["left_out_reasons"].items()
        )
        said.append(f"{figures['left_out']:,} record(s) were left out: {reasons}.")
    return said
