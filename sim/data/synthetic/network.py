"""Lays out what drivers look up in a town: lanes, rules and where they meet."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from . import conflicts, lines, signals
from .conflicts import Zones
from .town import Town

CELL = 1.0  # metres between the entries of a speed table
NO_LIGHT = -1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Network:
    """A town for those who drive in it."""

    town: Town
    length: Float[np.ndarray, " lanes"]  # metres
    limit: Float[np.ndarray, " lanes"]  # metres per second
    is_driven: Bool[np.ndarray, " lanes"]  # not by bicycles alone
    stops: Bool[np.ndarray, " lanes"]  # at a sign where the lane begins
    light: Int[np.ndarray, " lanes"]  # the light where it begins, or NO_LIGHT
    lit: Int[np.ndarray, " lights"]  # the lane of each light
    light_state: Int[np.ndarray, "lights steps"]  # LightState
    goes: Bool[
        np.ndarray, "lights_plus_1 steps"
    ]  # green; the last is where no light is
    warns: Bool[np.ndarray, "lights_plus_1 steps"]  # yellow
    successors: dict[int, tuple[int, ...]]
    neighbors: dict[int, tuple[int, ...]]
    curvature: tuple[Float[np.ndarray, " _"], ...]  # of each lane, unsigned [1/m]
    zones: Zones


def network(generator: np.random.Generator, town: Town, num_steps: int) -> Network:
    """Returns the network of a town, its lights at work for so many steps."""
    lit, shown = [], []
    for base, piece in zip(town.first_lane.tolist(), town.pieces, strict=True):
        if piece.signals is None:
            continue
        states = signals.states(generator, piece.signals, num_steps)
        for number, lane in enumerate(piece.lanes):
            if lane.group is not None:
                lit.append(base + number)
                shown.append(states[lane.group])
    light_state = np.array(shown, int).reshape(-1, num_steps)
    nowhere = np.ones((1, num_steps), bool)
    light = np.full(len(town.lanes), NO_LIGHT)
    light[lit] = np.arange(len(lit))
    curvature = [_curvature(lane.line) for lane in town.lanes]
    return Network(
        town=town,
        length=np.array([lines.stations(lane.line)[-1] for lane in town.lanes]),
        limit=np.array([lane.limit for lane in town.lanes]),
        is_driven=np.array([lane.map_type != 3 for lane in town.lanes]),
        stops=np.array([lane.stops for lane in town.lanes]),
        light=light,
        lit=np.array(lit, int),
        light_state=light_state,
        goes=np.concatenate([signals.goes(light_state), nowhere]),
        warns=np.concatenate([signals.warns(light_state), ~nowhere]),
        successors=_grouped(town.successor),
        neighbors=_grouped(town.neighbor),
        curvature=tuple(curvature),
        zones=conflicts.zones(town),
    )


def _curvature(line: lines.Line) -> Float[np.ndarray, " cells"]:
    """Returns how much a lane bends in each metre."""
    station, yaw = lines.stations(line), lines.headings(line)
    places = np.arange(0.0, station[-1] + CELL, CELL)
    return np.abs(np.diff(np.interp(places, station, yaw))) / CELL


def _grouped(pairs: tuple[tuple[int, int], ...]) -> dict[int, tuple[int, ...]]:
    groups: dict[int, tuple[int, ...]] = {}
    for a, b in pairs:
        groups[a] = (*groups.get(a, ()), b)
    return groups
