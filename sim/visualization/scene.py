"""Draws scenes: a scenario at one step, seen from above.

Motion comes from a rollout or from the log; pictures go to reports and videos. Drawing
opens no window and keeps no global state.
"""

import dataclasses
import io
from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib import axes, figure as mpl_figure, patheffects

from ..scenario import Scenario
from . import legend, objects, roads
from .trajectory import Trajectory
from .window import Window

BACKGROUND = "#f4f4f1"
INK = "#33373d"
FRAME = "#d8dade"

PANEL_INCHES = 3.6
SCALE_BARS = (100, 50, 20, 10, 5)  # metres


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One picture of a row of pictures."""

    title: str
    scenario: Scenario
    trajectory: Trajectory
    step: int  # of the scenario


def draw(
    ax: axes.Axes,
    scenario: Scenario,
    trajectory: Trajectory,
    step: int,
    *,
    radius: float = 40.0,
) -> list[str]:
    """Draws a scenario at one step, around its ego.

    The ego of the log is a dashed outline on a dotted path. An event is marked where
    the object was when it first happened.

    Args:
        ax: square axes, which are drawn over.
        scenario: the map, the sizes and kinds of objects, and the log.
        trajectory: where the objects are.
        step: of the scenario, among those of the trajectory.
        radius: from the ego to the sides of the picture [m].

    Returns:
        What is to be seen, in the words of the legend.

    Raises:
        ValueError: if the trajectory has no such step, or other objects than the
            scenario.
    """
    row = step - trajectory.start
    if not 0 <= row < len(trajectory.valid) or step >= scenario.num_steps:
        raise ValueError(
            f"step must be one of the trajectory's, {trajectory.start} to "
            f"{trajectory.start + len(trajectory.valid) - 1}, and of the scenario's "
            f"{scenario.num_steps}; got {step}"
        )
    if trajectory.valid.shape[1] != len(scenario.tracks.object_id):
        raise ValueError(
            f"the trajectory has {trajectory.valid.shape[1]} objects, scenario "
            f"{scenario.scenario_id} has {len(scenario.tracks.object_id)}"
        )
    window = _frame(ax, trajectory.xy[row, scenario.ego_index], radius)
    shown = roads.draw(ax, scenario, window, step)
    shown += objects.draw(ax, scenario, trajectory, window, step)
    _scale_bar(ax, window)
    seconds = (step - scenario.current_step) * scenario.dt
    _write(ax, 0.97, f"t = {seconds:.1f} s", "right")
    return shown


def figure(panels: Sequence[Panel], *, radius: float = 40.0) -> mpl_figure.Figure:
    """Draws pictures side by side, under their titles and over one legend.

    Args:
        panels: from left to right.
        radius: from each ego to the sides of its picture [m].
    """
    count, size = len(panels), PANEL_INCHES
    gap, head = 0.15, 0.32  # inches
    foot = 0.42 if count > 1 else 0.6
    width, height = count * (size + gap) + gap, head + size + foot
    fig = mpl_figure.Figure(figsize=(width, height), facecolor="white")
    shown: set[str] = set()
    for i, panel in enumerate(panels):
        left = gap + i * (size + gap)
        ax = fig.add_axes((left / width, foot / height, size / width, size / height))
        shown.update(
            draw(ax, panel.scenario, panel.trajectory, panel.step, radius=radius)
        )
        ax.set_title(panel.title, loc="left", fontsize=9.5, color=INK, pad=5)
    handles = legend.handles(shown)
    fig.legend(
        handles=handles,
        loc="lower center",
        ncols=len(handles) if count > 1 else 4,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handletextpad=0.4,
        columnspacing=1.3,
        borderaxespad=0.35,
    )
    return fig


def to_png(fig: mpl_figure.Figure, *, dpi: int = 150) -> bytes:
    """Returns a figure as a PNG file."""
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def _frame(ax: axes.Axes, center: np.ndarray, radius: float) -> Window:
    ax.set_xlim(center[0] - radius, center[0] + radius)
    ax.set_ylim(center[1] - radius, center[1] + radius)
    ax.set_aspect("equal")
    ax.set_facecolor(BACKGROUND)
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_color(FRAME)
    extent = ax.get_window_extent()
    inches = min(extent.width, extent.height) / ax.figure.dpi
    return Window(
        center=center, radius=radius, points_per_metre=72 * inches / (2 * radius)
    )


def _scale_bar(ax: axes.Axes, window: Window) -> None:
    """Draws the longest round length that takes at most a third of the width."""
    metres = next(
        (length for length in SCALE_BARS if length <= window.radius * 2 / 3),
        SCALE_BARS[-1],
    )
    left = window.center[0] - 0.94 * window.radius
    bottom = window.center[1] - 0.86 * window.radius
    ax.plot(
        [left, left + metres],
        [bottom, bottom],
        color=INK,
        linewidth=2,
        solid_capstyle="butt",
        zorder=9,
    )
    _write(ax, 0.03, f"{metres} m", "left")


def _write(ax: axes.Axes, x: float, text: str, align: Literal["left", "right"]) -> None:
    ax.text(
        x,
        0.025,
        text,
        transform=ax.transAxes,
        horizontalalignment=align,
        fontsize=8,
        color=INK,
        zorder=9,
        path_effects=[patheffects.withStroke(linewidth=2, foreground=BACKGROUND)],
    )
