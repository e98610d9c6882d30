"""Draws distributions, one panel each, of one source or of two beside each other."""

import io
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib import axes, figure as mpl_figure, ticker

Values = Float[np.ndarray, " values"]

COLUMNS = 4
NUM_BINS = 30
TAILS = (0.5, 99.5)  # percentiles beyond which values join the outer bins
COLORS = ("#0072b2", "#d55e00")  # told apart by the colour-blind
AXIS_COLOR = "#555555"


def draw(
    panels: Mapping[str, Mapping[str, Values]],
    notes: Mapping[str, str] | None = None,
    title: str | None = None,
) -> bytes:
    """Draws histograms as a PNG.

    Args:
        panels: by title, the values of each source by its name; a source of shares of 0
            and 1 alone becomes a bar.
        notes: by title, a word to add.
        title: of the whole.
    """
    rows = math.ceil(len(panels) / COLUMNS)
    fig = mpl_figure.Figure(
        figsize=(3.4 * COLUMNS, 2.6 * rows), layout="constrained", dpi=110
    )
    grid = np.atleast_1d(fig.subplots(rows, COLUMNS, squeeze=False)).ravel()
    for ax, (name, sources) in zip(grid, panels.items(), strict=False):
        note = (notes or {}).get(name)
        _panel(ax, sources)
        ax.set_title(f"{name}\n{note}" if note else name, fontsize=9)
    for ax in grid[len(panels) :]:
        ax.set_visible(False)
    if title is not None:
        fig.suptitle(title, fontsize=11)
    fig.supylabel("share of what is counted", fontsize=9)
    handles, labels = grid[0].get_legend_handles_labels()
    if len(labels) > 1:
        fig.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _panel(ax: axes.Axes, sources: Mapping[str, Values]) -> None:
    known = [found for found in sources.values() if len(found)]
    ax.spines[["top", "right", "left"]].set_visible(False)
    ax.tick_params(colors=AXIS_COLOR, labelsize=8)
    ax.set_yticks([])
    if not known:
        ax.text(0.5, 0.5, "none", ha="center", transform=ax.transAxes)
        return
    every = np.concatenate(known)
    if np.isin(every, (0.0, 1.0)).all():
        _shares(ax, sources)
        return
    ax.xaxis.set_major_locator(
        ticker.MaxNLocator(5, integer=_is_whole(every), min_n_ticks=1)
    )
    ax.xaxis.set_major_formatter(ticker.StrMethodFormatter("{x:,g}"))
    bins = _bins(every)
    for color, (name, found) in zip(COLORS, sources.items(), strict=False):
        inside = np.clip(found, bins[0], bins[-1])
        weights = np.full(len(found), 1 / max(len(found), 1))
        ax.hist(inside, list(bins), weights=weights, color=color, alpha=0.2)
        ax.hist(
            inside,
            list(bins),
            weights=weights,
            color=color,
            histtype="step",
            lw=1.5,
            label=name,
        )


def _is_whole(every: Values) -> bool:
    return np.array_equal(every, np.round(every))


def _bins(every: Values) -> Float[np.ndarray, " edges"]:
    low, high = np.percentile(every, TAILS)
    if _is_whole(every) and high - low < NUM_BINS:
        return np.arange(low - 0.5, high + 1.0)
    return np.linspace(low, high if high > low else low + 1, NUM_BINS + 1)


def _shares(ax: axes.Axes, sources: Mapping[str, Values]) -> None:
    names: Sequence[str] = list(sources)
    shares = [100 * float(sources[name].mean()) for name in names]
    bars = ax.bar(names, shares, color=COLORS[: len(names)], alpha=0.6)
    ax.bar_label(bars, fmt="%.0f %%", fontsize=8)
    ax.set_ylim(0, 115)
    ax.set_xticks([])
