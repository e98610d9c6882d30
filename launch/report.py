"""Writes the report of a run: one HTML file that needs no other and no network.

Rows come from `tables`, pictures from `sim.visualization` and from the logbook.
"""

import base64
import dataclasses
import html
import io
import os
import shlex
import sys
from collections.abc import Mapping, Sequence

import jax
import matplotlib
import numpy as np
from matplotlib import figure as mpl_figure, ticker

from ..sim import files
from . import tables, versions

# Mid-tones that can be read on white and on black.
CURVE_COLOR = "#3b82c4"
AXIS_COLOR = "#7d848f"

STYLE = """
:root { color-scheme: light dark; --ink: #1f2328; --soft: #626a75; --line: #dfe2e6;
  --page: #ffffff; --card: #f6f7f8; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e7eb; --soft: #99a1ac;
  --line: #333941; --page: #15181c; --card: #1d2126; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 2rem 1.25rem 4rem; color: var(--ink);
  background: var(--page); font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2.5rem 0 .75rem; }
p, figcaption { color: var(--soft); margin: .5rem 0; font-size: .9rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums;
  font-size: .93rem; }
table.results { min-width: 100%; }
th, td { padding: .45rem .9rem .45rem 0; text-align: right; vertical-align: top;
  white-space: nowrap; }
th { font-weight: 600; }
thead th { vertical-align: bottom; }
th:first-child, th.name, td.name { text-align: left; }
thead th { border-bottom: 2px solid var(--line); }
tbody tr { border-bottom: 1px solid var(--line); }
small { color: var(--soft); display: block; font-size: .8rem; font-weight: 400; }
figure { margin: 1rem 0; }
figure img { width: 100%; height: auto; display: block; border-radius: 8px; }
figure.rollout img { width: auto; max-width: max(100%, 44rem); background: white;
  border: 1px solid var(--line); }
.facts th { font-weight: 400; color: var(--soft); padding-right: 1.5rem; }
.facts td { text-align: left; white-space: normal; overflow-wrap: anywhere; }
pre { background: var(--card); border: 1px solid var(--line); border-radius: 8px;
  padding: .9rem 1rem; overflow-x: auto; font-size: .85rem; line-height: 1.45; }
code { font-family: ui-monospace, monospace; }
summary { cursor: pointer; color: var(--soft); font-size: .9rem; }
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Curve:
    """What was measured during training, step by step."""

    label: str  # of the value, with its unit
    steps: Sequence[int | float]
    values: Sequence[int | float | None]  # None where there was no finite value
    step_label: str = "environment steps"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Picture:
    """A drawn rollout, as a PNG file, and what there is to say about it."""

    png: bytes
    caption: str  # names the scenario and how it ended


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    """All that a report shows; empty parts are left out."""

    title: str
    summary: str  # one or two sentences
    rows: Sequence[tables.Row] = ()
    curves: Sequence[Curve] = ()
    pictures: Sequence[Picture] = ()
    config: str = ""  # YAML
    facts: Mapping[str, str] = dataclasses.field(default_factory=dict)


def write(path: str | os.PathLike[str], report: Report) -> None:
    """Writes a report, whole or not at all."""
    files.write_whole(path, render(report))


def render(report: Report) -> str:
    """Returns the report as HTML; nothing that it inserts can act as markup."""
    body = [f"<h1>{_text(report.title)}</h1>", f"<p>{_text(report.summary)}</p>"]
    if report.rows:
        body += ["<h2>Results</h2>", _results(report.rows)]
    if report.curves:
        body.append("<h2>Learning</h2>")
        for curve in report.curves:
            caption = f"{curve.label}, by {curve.step_label}"
            body.append(_figure("curve", "svg+xml", _draw(curve), caption))
    if report.pictures:
        body.append("<h2>Rollouts</h2>")
        body += [
            _figure("rollout", "png", picture.png, picture.caption)
            for picture in report.pictures
        ]
    if report.facts:
        body += ["<h2>How it was made</h2>", _facts(report.facts)]
    if report.config:
        body.append(
            "<details><summary>Config as resolved</summary>"
            f"<pre><code>{_text(report.config)}</code></pre></details>"
        )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{_text(report.title)}</title><style>{STYLE}</style></head>\n<body>"
        + "\n".join(body)
        + "</body></html>\n"
    )


def environment() -> dict[str, str]:
    """Returns what results depend on besides the config: command, device, versions."""
    devices = jax.devices()
    return {
        "Command": shlex.join([os.path.basename(sys.argv[0]), *sys.argv[1:]]),
        "Device": f"{len(devices)} x {devices[0].device_kind} ({devices[0].platform}), "
        f"{os.cpu_count()} CPU cores on this host",
        "Versions": ", ".join(
            f"{name} {version}" for name, version in versions.here().items()
        ),
    }


def _text(text: str) -> str:
    return html.escape(text, quote=True)


def _results(rows: Sequence[tables.Row]) -> str:
    columns = tables.columns_of(rows)
    head = "".join(
        f'<th scope="col">{_text(column.title)}<small>{_text(column.unit)}</small></th>'
        for column in columns
    )
    lines = []
    for row in rows:
        cells = "".join(
            f"<td>{_text(value)}<small>{_text(spread)}</small></td>"
            for value, spread in (tables.cell(row, column) for column in columns)
        )
        lines.append(
            f'<tr><th scope="row" class="name">{_text(str(row["agent"]))}</th>'
            f'<td class="name">{_text(str(row["sim_agent"]))}</td>'
            f"<td>{row['episodes']:,}</td>{cells}</tr>"
        )
    return (
        '<div class="scroll"><table class="results"><thead><tr>'
        '<th scope="col" class="name">Agent</th>'
        '<th scope="col" class="name">Sim agents</th>'
        f'<th scope="col">Episodes</th>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
        + "".join(f"<p>{_text(note)}</p>" for note in tables.notes(rows))
    )


def _figure(name: str, kind: str, data: bytes, caption: str) -> str:
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return (
        f'<figure class="{name}"><div class="scroll">'
        f'<img src="{source}" alt="{_text(caption)}"></div>'
        f"<figcaption>{_text(caption)}</figcaption></figure>"
    )


def _facts(facts: Mapping[str, str]) -> str:
    lines = "".join(
        f'<tr><th scope="row">{_text(name)}</th><td>{_text(fact)}</td></tr>'
        for name, fact in facts.items()
    )
    return f'<table class="facts"><tbody>{lines}</tbody></table>'


def _draw(curve: Curve) -> bytes:
    """Draws a curve as SVG, on no background."""
    fig = mpl_figure.Figure(figsize=(10, 3.2), layout="constrained")
    fig.patch.set_alpha(0)
    ax = fig.add_subplot()
    ax.patch.set_alpha(0)
    marker = "o" if len(curve.steps) < 30 else None
    values = np.array(curve.values, np.float64)  # None becomes NaN, a gap in the line
    ax.plot(curve.steps, values, color=CURVE_COLOR, lw=1.6, marker=marker, ms=4)
    ax.xaxis.set_major_formatter(ticker.EngFormatter(sep=""))
    ax.set_xlabel(curve.step_label, color=AXIS_COLOR)
    ax.set_ylabel(curve.label, color=AXIS_COLOR)
    ax.tick_params(colors=AXIS_COLOR)
    ax.grid(color=AXIS_COLOR, alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color(AXIS_COLOR)
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "drivetrain"}):
        fig.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
