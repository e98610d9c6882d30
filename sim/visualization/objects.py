"""Draws the road users of a scenario: boxes, where they came from, what befell them."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib import axes, collections, colors, lines

from ..scenario import ObjectType, Scenario
from .trajectory import Trajectory
from .window import Window

# The palette of Okabe & Ito (2008), which all kinds of colour vision tell apart.
EGO = "#0072b2"
KINDS = {
    "vehicle": ("#868c95", (ObjectType.VEHICLE,)),
    "cyclist": ("#cc79a7", (ObjectType.CYCLIST,)),
    "pedestrian": ("#e69f00", (ObjectType.PEDESTRIAN,)),
    "other": ("#4b4f56", (ObjectType.OTHER, ObjectType.UNSET)),
}
EVENT = "#d55e00"
EVENT_MARKERS = {"collision": "X", "off-road": "D"}

TRAIL_STEPS = 20
MIN_SIZE = 1.0  # metres: a pedestrian of half a metre would be two dots

BOX = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / 2
NOSE = np.array([(0.84, 0.0), (0.3, 0.6), (0.3, -0.6)]) / 2  # shows where front is


def draw(
    ax: axes.Axes,
    scenario: Scenario,
    trajectory: Trajectory,
    window: Window,
    step: int,
) -> list[str]:
    """Draws trails, the logged ego, boxes and events; returns the words for them."""
    row = step - trajectory.start
    shown = _ghost(ax, scenario, step)
    _trails(ax, scenario, trajectory, row)
    for word, (color, types) in KINDS.items():
        mask = np.isin(scenario.tracks.object_type, [int(kind) for kind in types])
        mask &= trajectory.valid[row] & window.contains(trajectory.xy[row])
        mask[scenario.ego_index] = False
        if mask.any():
            shown.append(word)
            _boxes(ax, scenario, trajectory, row, mask, color)
    ego = np.arange(len(scenario.tracks.object_id)) == scenario.ego_index
    _boxes(ax, scenario, trajectory, row, ego, EGO)
    return [*shown, "ego", *_events(ax, trajectory, window, row)]


def outlines(
    xy: Float[np.ndarray, "objects 2"],
    yaw: Float[np.ndarray, " objects"],
    size: Float[np.ndarray, "objects 2"],
    shape: Float[np.ndarray, "corners 2"] = BOX,
) -> Float[np.ndarray, "objects corners 2"]:
    """Places a shape on each object.

    Args:
        xy: centres [m].
        yaw: headings [rad].
        size: lengths and widths [m].
        shape: corners in units of the size, with the nose along +x.
    """
    corner = shape * size[:, None]
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x = cos * corner[..., 0] - sin * corner[..., 1]
    y = sin * corner[..., 0] + cos * corner[..., 1]
    return xy[:, None] + np.stack([x, y], axis=-1)


def _boxes(
    ax: axes.Axes,
    scenario: Scenario,
    trajectory: Trajectory,
    row: int,
    mask: Bool[np.ndarray, " objects"],
    color: str,
) -> None:
    pose = trajectory.xy[row, mask], trajectory.yaw[row, mask]
    size = np.maximum(scenario.tracks.size[mask, :2], MIN_SIZE)
    zorder = 5 if color == EGO else 4
    for shape, face, edge in ((BOX, color, "white"), (NOSE, "white", "none")):
        ax.add_collection(
            collections.PolyCollection(
                [*outlines(*pose, size, shape)],
                facecolors=face,
                edgecolors=edge,
                linewidths=0.4,
                zorder=zorder,
            ),
            autolim=False,
        )


def _ghost(ax: axes.Axes, scenario: Scenario, step: int) -> list[str]:
    """Draws the logged path of the ego, and its logged box at the step."""
    tracks, ego = scenario.tracks, scenario.ego_index
    valid = tracks.valid[ego]
    path = np.where(valid[:, None], tracks.xyz[ego, :, :2], np.nan)
    ax.plot(*path.T, color=EGO, linewidth=1.0, linestyle=(0, (1, 1.6)), zorder=2.2)
    if valid[step]:
        corners = outlines(
            tracks.xyz[ego, [step], :2], tracks.yaw[ego, [step]], tracks.size[[ego], :2]
        )[0]
        ax.fill(*corners.T, fill=False, ec=EGO, lw=1.0, ls=(0, (3, 1.5)), zorder=3)
    return ["logged ego"]


def _trails(
    ax: axes.Axes, scenario: Scenario, trajectory: Trajectory, row: int
) -> None:
    """Draws where everyone was in the last steps, and all the way of the ego."""
    first = max(row - TRAIL_STEPS, 0)
    for word_color, types in KINDS.values():
        mask = np.isin(scenario.tracks.object_type, [int(kind) for kind in types])
        mask[scenario.ego_index] = False
        _trail(ax, trajectory, slice(first, row + 1), mask, word_color, 1.2)
    ego = np.arange(len(scenario.tracks.object_id)) == scenario.ego_index
    _trail(ax, trajectory, slice(0, row + 1), ego, EGO, 2.0)


def _trail(
    ax: axes.Axes,
    trajectory: Trajectory,
    rows: slice,
    mask: Bool[np.ndarray, " objects"],
    color: str,
    width: float,
) -> None:
    """Draws a line that fades into the past."""
    xy, valid = trajectory.xy[rows, mask], trajectory.valid[rows, mask]
    pieces = np.stack([xy[:-1], xy[1:]], axis=2)
    both = valid[:-1] & valid[1:]
    alpha = np.broadcast_to(np.linspace(0.1, 0.8, len(both))[:, None], both.shape)
    shades = np.tile(colors.to_rgba(color), (int(both.sum()), 1))
    shades[:, 3] = alpha[both]
    ax.add_collection(
        collections.LineCollection(
            [*pieces[both]], colors=shades, linewidths=width, zorder=3
        ),
        autolim=False,
    )


def _events(
    ax: axes.Axes, trajectory: Trajectory, window: Window, row: int
) -> list[str]:
    """Marks where each object first collided or left the road."""
    shown = []
    events = {"collision": trajectory.collision, "off-road": trajectory.offroad}
    for word, flags in events.items():
        if flags is None:
            continue
        past = flags[: row + 1] & trajectory.valid[: row + 1]
        happened = np.flatnonzero(past.any(axis=0))
        place = trajectory.xy[past.argmax(axis=0)[happened], happened]
        place = place[window.contains(place)]
        if len(place):
            shown.append(word)
            sign = event_sign(word)
            sign.set_data(*place.T)
            ax.add_line(sign)
    return shown


def event_sign(word: str) -> lines.Line2D:
    """Makes the sign of an event, without a place yet."""
    return lines.Line2D(
        [],
        [],
        linestyle="none",
        marker=EVENT_MARKERS[word],
        markersize=7,
        color=EVENT,
        mec="white",
        mew=0.8,
        zorder=7,
        label=word,
    )
