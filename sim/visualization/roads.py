"""Draws the map of a scenario: the ground on which `scene` puts the road users."""

from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib import axes, collections, lines

from ..scenario import DRIVING_LANES, EDGES, LightState, MapType, Paths, Scenario
from .window import Window

SURFACE = "#e3e5e8"
BIKE_SURFACE = "#e1e8df"
PAINT = "#ffffff"
YELLOW_PAINT = "#e3b341"
CROSSWALK = "#f6f6f4"
OUTLINE = "#b4b8bf"
EDGE = "#5d626b"
ROUTES = {"off route": "#cfd9e2", "route": "#a9cbe6"}
STOP = "#d55e00"
STOP_SIGN = "stop sign"

LANE_WIDTH = 3.7  # metres
BIKE_LANE_WIDTH = 1.8
ROUTE_WIDTH = 1.6
DASH = (3.0, 6.0)  # metres of paint, metres of gap

BROKEN_WHITE = (MapType.LINE_BROKEN_SINGLE_WHITE,)
BROKEN_YELLOW = (
    MapType.LINE_BROKEN_SINGLE_YELLOW,
    MapType.LINE_BROKEN_DOUBLE_YELLOW,
    MapType.LINE_PASSING_DOUBLE_YELLOW,
)
WHITE = (
    MapType.LINE_UNKNOWN,
    MapType.LINE_SOLID_SINGLE_WHITE,
    MapType.LINE_SOLID_DOUBLE_WHITE,
)
YELLOW = (MapType.LINE_SOLID_SINGLE_YELLOW, MapType.LINE_SOLID_DOUBLE_YELLOW)

# Colour, marker and word: three ways to tell a light.
LIGHTS = {
    "red light": (
        STOP,
        "s",
        (LightState.STOP, LightState.ARROW_STOP, LightState.FLASHING_STOP),
    ),
    "amber light": (
        "#f0e442",
        "^",
        (LightState.CAUTION, LightState.ARROW_CAUTION, LightState.FLASHING_CAUTION),
    ),
    "green light": ("#009e73", "o", (LightState.GO, LightState.ARROW_GO)),
}

Points = Float[np.ndarray, "points 2"]


def draw(ax: axes.Axes, scenario: Scenario, window: Window, step: int) -> list[str]:
    """Draws the map and what the lights show; returns the words for the legend."""

    def runs(*map_types: MapType) -> list[Points]:
        return _runs(scenario, map_types, window)

    metre = window.points_per_metre
    _stroke(ax, runs(MapType.LANE_BIKE), BIKE_SURFACE, BIKE_LANE_WIDTH * metre, 1.0)
    _stroke(ax, runs(*DRIVING_LANES), SURFACE, LANE_WIDTH * metre, 1.1)
    _fill(ax, runs(MapType.DRIVEWAY), SURFACE, SURFACE, 1.1)
    shown = _routes(ax, scenario.paths, window) if scenario.paths else []
    _fill(ax, runs(MapType.CROSSWALK), CROSSWALK, OUTLINE, 1.4)
    _fill(ax, runs(MapType.SPEED_BUMP), SURFACE, OUTLINE, 1.4)
    gaps = tuple(length * metre for length in DASH)
    _stroke(ax, runs(*WHITE), PAINT, 0.9, 1.5)
    _stroke(ax, runs(*YELLOW), YELLOW_PAINT, 0.9, 1.5)
    _stroke(ax, runs(*BROKEN_WHITE), PAINT, 0.9, 1.5, gaps)
    _stroke(ax, runs(*BROKEN_YELLOW), YELLOW_PAINT, 0.9, 1.5, gaps)
    _stroke(ax, runs(*EDGES), EDGE, 1.1, 1.6)
    shown += _stop_signs(ax, scenario, window)
    return shown + _lights(ax, scenario, window, step)


def sign(word: str) -> lines.Line2D:
    """Makes the sign for a word, without a place yet."""
    color, marker, _ = LIGHTS.get(word, (STOP, "8", ()))
    is_light = word in LIGHTS
    return lines.Line2D(
        [],
        [],
        linestyle="none",
        marker=marker,
        markersize=5.5,
        color=color if is_light else "white",
        mec="white" if is_light else color,
        mew=0.7 if is_light else 1.4,
        zorder=1.9,
        label=word,
    )


def _put(ax: axes.Axes, word: str, points: Points) -> list[str]:
    if not len(points):
        return []
    signs = sign(word)
    signs.set_data(*points.T)
    ax.add_line(signs)
    return [word]


def _stop_signs(ax: axes.Axes, scenario: Scenario, window: Window) -> list[str]:
    found = _runs(scenario, (MapType.STOP_SIGN,), window)
    points = np.array([points[0] for points in found]).reshape(-1, 2)
    return _put(ax, STOP_SIGN, points[window.contains(points)])


def _lights(ax: axes.Axes, scenario: Scenario, window: Window, step: int) -> list[str]:
    xy = scenario.lights.xyz[:, :2]
    mask = scenario.lights.valid[:, step] & window.contains(xy)
    shown = []
    for word, (_, _, states) in LIGHTS.items():
        is_on = np.isin(scenario.lights.state[:, step], [int(s) for s in states])
        shown += _put(ax, word, xy[mask & is_on])
    return shown


def _routes(ax: axes.Axes, paths: Paths, window: Window) -> list[str]:
    """Draws ways off the route first, so that the route covers what they share."""
    shown = []
    for on_route, (word, color) in enumerate(ROUTES.items()):
        chosen = [
            points[:, :2]
            for i in np.flatnonzero(paths.on_route == on_route)
            if len(points := paths.points_of(int(i))) and window.meets(points[:, :2])
        ]
        _stroke(ax, chosen, color, ROUTE_WIDTH * window.points_per_metre, 1.2)
        shown += [word] if chosen else []
    return shown


def _runs(
    scenario: Scenario, map_types: Collection[MapType], window: Window
) -> list[Points]:
    wanted = np.isin(scenario.roads.map_type, [int(kind) for kind in map_types])
    found = [scenario.roads.points_of(int(i))[:, :2] for i in np.flatnonzero(wanted)]
    return [points for points in found if len(points) and window.meets(points)]


def _stroke(
    ax: axes.Axes,
    runs: Sequence[Points],
    color: str,
    width: float,
    zorder: float,
    gaps: tuple[float, ...] = (),
) -> None:
    """Strokes lines of a width in points; `gaps` are the lengths of paint and gap."""
    style = (0.0, tuple(length / width for length in gaps)) if gaps else "solid"
    ax.add_collection(
        collections.LineCollection(
            [*runs],
            colors=color,
            linewidths=width,
            linestyles=[style],
            capstyle="butt" if gaps else "round",
            joinstyle="round",
            zorder=zorder,
        ),
        autolim=False,
    )


def _fill(
    ax: axes.Axes, runs: Sequence[Points], color: str, outline: str, zorder: float
) -> None:
    ax.add_collection(
        collections.PolyCollection(
            [*runs], facecolors=color, edgecolors=outline, linewidths=0.7, zorder=zorder
        ),
        autolim=False,
    )
