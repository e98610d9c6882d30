"""Writes the report of a benchmark: its table and its plots, in a folder."""

import base64
import html
import io
import pathlib
from collections.abc import Mapping, Sequence

import matplotlib
from matplotlib import figure as mpl_figure, ticker

from ...sim import files
from ..report import AXIS_COLOR, STYLE
from .base import Plot


def write(
    folder: pathlib.Path,
    title: str,
    table: str,
    plots: Sequence[Plot],
    facts: Mapping[str, str],
) -> None:
    """Writes `report.html`, which needs no other file, and each plot as SVG and PNG.

    Args:
        folder: where to write; made if it is not there.
        title: of the page.
        table: as text.
        plots: what to draw.
        facts: what the figures depend on, by name.
    """
    drawn = {plot.name: draw(plot) for plot in plots}
    for name, pictures in drawn.items():
        for kind, picture in pictures.items():
            files.write_whole(folder / f"{name}.{kind}", picture)
    figures = "".join(
        f'<figure><img src="data:image/svg+xml;base64,{_base64(pictures["svg"])}" '
        f'alt="{html.escape(name)}"></figure>'
        for name, pictures in drawn.items()
    )
    lines = "".join(
        f'<tr><th scope="row">{html.escape(name)}</th><td>{html.escape(fact)}</td></tr>'
        for name, fact in facts.items()
    )
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style></head>\n<body>"
        f"<h1>{html.escape(title)}</h1>\n<pre>{html.escape(table)}</pre>\n{figures}\n"
        f'<table class="facts"><tbody>{lines}</tbody></table></body></html>\n'
    )
    files.write_whole(folder / "report.html", page)


def _base64(picture: bytes) -> str:
    return base64.b64encode(picture).decode()


def draw(plot: Plot) -> dict[str, bytes]:
    """Draws a plot, both axes logarithmic, as `svg` and as `png`."""
    fig = mpl_figure.Figure(figsize=(8, 4.5), layout="constrained")
    ax = fig.add_subplot()
    for label, (x, y) in plot.lines.items():
        ax.plot(x, y, marker="o", ms=4, lw=1.6, label=label)
    ax.set_xscale("log", base=2)
    ax.set_yscale("log")
    ax.set_xticks(sorted({place for x, _ in plot.lines.values() for place in x}))
    ax.yaxis.set_minor_locator(ticker.LogLocator(subs=(2, 5)))
    for formatter in (
        ax.xaxis.set_major_formatter,
        ax.yaxis.set_major_formatter,
        ax.yaxis.set_minor_formatter,
    ):
        formatter(ticker.FuncFormatter(lambda value, _: f"{value:,.6g}"))
    ax.set_xlabel(plot.x_label, color=AXIS_COLOR)
    ax.set_ylabel(plot.y_label, color=AXIS_COLOR)
    ax.tick_params(which="both", colors=AXIS_COLOR)
    ax.grid(color=AXIS_COLOR, alpha=0.25, linewidth=0.6)
    low, high = ax.get_ylim()
    if high < 10 * low:  # so that what differs little looks so
        ax.set_ylim((low * high / 10) ** 0.5, (low * high * 10) ** 0.5)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False)
    pictures = {}
    with matplotlib.rc_context({"svg.hashsalt": "drivetrain"}):
        for kind, metadata in (("svg", {"Date": None}), ("png", {"Software": None})):
            buffer = io.BytesIO()
            fig.savefig(buffer, format=kind, metadata=metadata)
            pictures[kind] = buffer.getvalue()
    return pictures
