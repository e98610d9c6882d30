"""Finds the paths that the ego could take from its start (`definitions.md` section 5).

Readers hand over scenarios without paths; route metrics and observations use the paths.
"""

import dataclasses
import heapq
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import Paths, Scenario
from .lane_graph import LaneGraph, lane_graph, stations

SPACING = 0.5  # metres between the points of a path
BEYOND = 30.0  # metres that a path goes on after the logged distance, if lanes do
MAX_PATHS = 32
MAX_EXPANSIONS = 1000  # lanes looked at in one search, so that cycles end
START_DISTANCE = 5.0  # metres from the ego's start to its lanes, at most
START_COSINE = np.cos(np.radians(60.0))  # the lane's direction against the ego's yaw
FOLLOW_DISTANCE = 4.0  # metres beside the log: a change of lane stays on route
FOLLOW_SHARE = 0.9  # of the logged way
CHANGE_LENGTH = 10.0  # metres along the road that a lane change takes
CHANGE_PENALTY = 1.0  # metres nearer to the log that a neighbour lane must be
FIRST_EDGES = 4  # of a way, beside one of which the ego starts
LOG_SPACING = 2.0  # metres between the logged positions that paths are compared with


class _Branch(NamedTuple):
    """A way not yet followed to its end; heaps compare the first three fields."""

    departures: int  # how often it took another lane than the one nearest to the log
    length: float  # metres from the ego's start to `point`; below 0 for one behind it
    order: int
    lane: int
    point: int  # where it enters the lane
    pieces: tuple[tuple[int, int], ...]  # first and last points before that
    is_change: bool


def with_paths(scenario: Scenario) -> Scenario:
    """Returns the scenario with its paths."""
    return dataclasses.replace(scenario, paths=paths_of(scenario))


def paths_of(scenario: Scenario) -> Paths:
    """Returns the paths of a scenario: its own if one is on-route, else found ones.

    Each path starts beside the ego's first valid position and follows lanes for the
    logged distance and 30 m more, or until the lanes end. A path is on-route if
    90 % of the logged way and the logged end lie within 4 m of it, and it leads there
    in the direction of the ego's yaw (within 90 degrees). If no path does, the logged
    track itself, 30 m straight on, becomes the first path.

    The search is best first: by how often a way departs from the lanes nearest to the
    log, then by its length. So its limits drop what is farthest from what the ego did.
    It changes only into lanes that no way has entered yet: one path per lane, not one
    per place to change. Lanes within 5 m of the start that point within 60 degrees of
    the ego's yaw count as changes too, as lanes overlap in junctions.

    On-route paths come first, and among them those that pass nearest to the logged end:
    where paths run together, the first one counts.

    The source is that of the route: `lane_graph` or `lane_ends` where lanes lead there,
    and `log` where the logged track stands in. Lane ends tell of no neighbours: with
    them there are no changes later on.
    """
    if scenario.paths is not None and scenario.paths.on_route.any():
        return scenario.paths
    ego, steps = scenario.ego_index, scenario.tracks.valid[scenario.ego_index]
    logged = scenario.tracks.xyz[ego, steps]
    yaw = scenario.tracks.yaw[ego, steps]
    track = _spaced(logged)
    straight = np.array([np.cos(yaw[-1]), np.sin(yaw[-1]), 0.0])
    track_on = np.concatenate([track, track[-1:] + BEYOND * straight])
    length = stations(track)[-1] + BEYOND

    graph = lane_graph(scenario.roads, scenario.lane_links)
    starts = _starts(graph, logged[0], yaw[0])
    ways = _search(graph, starts, logged[0], length, _resample(track_on, LOG_SPACING))
    found = _distinct([_path(graph, pieces, logged[0], length) for pieces in ways])
    follows = _on_route(found, _resample(track, LOG_SPACING), logged[-1], yaw[-1])
    on_route = follows
    if not follows.any():
        of_log = _resample(track_on, SPACING)
        of_log = np.concatenate([of_log, np.zeros((len(of_log), 1))], axis=1)
        found = [of_log, *found][:MAX_PATHS]
        on_route = np.arange(len(found)) == 0
    if not follows.any():
        source = "log"
    else:
        source = "lane_ends" if scenario.lane_links is None else "lane_graph"
    miss = [np.linalg.norm(path[:, :3] - logged[-1], axis=1).min() for path in found]
    order = np.lexsort((miss, ~on_route))
    points = np.concatenate([found[i] for i in order])
    return Paths(
        xyz=points[:, :3],
        speed_limit=points[:, 3],
        is_limited=points[:, 3] > 0,
        offset=np.cumsum([0, *(len(found[i]) for i in order)]),
        on_route=on_route[order],
        source=source,
    )


def _starts(
    graph: LaneGraph, position: Float[np.ndarray, " 3"], yaw: float
) -> list[tuple[int, int]]:
    """Returns the lanes at the ego, nearest first, each with its point at or behind."""
    ends_lane = np.zeros(len(graph.xyz), bool)
    ends_lane[graph.last] = True
    points = np.flatnonzero(~ends_lane)
    edge = graph.xyz[points + 1, :2] - graph.xyz[points, :2]
    squared = np.maximum(np.sum(edge**2, axis=-1), 1e-9)
    to_ego = position[:2] - graph.xyz[points, :2]
    along = np.clip(np.sum(to_ego * edge, axis=-1) / squared, 0.0, 1.0)
    distance = np.linalg.norm(to_ego - along[:, None] * edge, axis=-1)
    heading = np.array([np.cos(yaw), np.sin(yaw)])
    near = (distance <= START_DISTANCE) & (
        edge @ heading >= START_COSINE * np.sqrt(squared)
    )
    points = points[near][np.argsort(distance[near], kind="stable")]
    lanes = np.searchsorted(graph.last, points)
    firsts = np.sort(np.unique(lanes, return_index=True)[1])
    return [(int(lanes[i]), int(points[i])) for i in firsts]


def _search(
    graph: LaneGraph,
    starts: list[tuple[int, int]],
    position: Float[np.ndarray, " 3"],
    length: float,
    log: Float[np.ndarray, "steps 3"],
) -> list[tuple[tuple[int, int], ...]]:
    """Returns ways through the lanes as runs of points, the fewest departures first."""
    ways = []
    heap = [
        _Branch(min(i, 1), -_behind(graph, point, position), i, lane, point, (), i > 0)
        for i, (lane, point) in enumerate(starts)
    ]
    entered = set()
    distances = {}
    order = len(heap)
    for _ in range(MAX_EXPANSIONS):
        if not heap or len(ways) == MAX_PATHS:
            break
        branch = heapq.heappop(heap)
        if branch.is_change and branch.lane in entered:
            continue
        entered.add(branch.lane)
        children = _changes(graph, branch)
        ahead = _successors(graph, branch, length)
        if not ahead:
            ways.append((*branch.pieces, (branch.point, graph.last[branch.lane])))
        for child in (*ahead, *children):
            if child.lane not in distances:
                distances[child.lane] = _distance(graph, child.lane, log)
        children = sorted(
            (*ahead, *children),
            key=lambda child: distances[child.lane] + CHANGE_PENALTY * child.is_change,
        )
        for rank, child in enumerate(children):
            order += 1
            departures = branch.departures + (rank > 0 or not ahead)
            heapq.heappush(heap, child._replace(departures=departures, order=order))
    return ways


def _behind(graph: LaneGraph, point: int, position: Float[np.ndarray, " 3"]) -> float:
    """Returns how far a point of a lane lies behind a place beside its edge [m]."""
    edge = graph.xyz[point + 1, :2] - graph.xyz[point, :2]
    length = np.hypot(*edge)
    along = (position - graph.xyz[point])[:2] @ edge / max(length, 1e-9)
    return float(np.clip(along, 0.0, length))


def _successors(graph: LaneGraph, branch: _Branch, length: float) -> list[_Branch]:
    """Returns the ways on from the lane's end, none where the way is long enough."""
    last = graph.last[branch.lane]
    reached = branch.length + graph.station[last] - graph.station[branch.point]
    if reached >= length:
        return []
    pieces = (*branch.pieces, (branch.point, last))
    return [
        _Branch(0, reached, 0, lane, graph.first[lane], pieces, False)
        for lane in graph.successors.get(branch.lane, ())
    ]


def _changes(graph: LaneGraph, branch: _Branch) -> list[_Branch]:
    """Returns the lane changes, each where the neighbour first runs beside the lane."""
    found = []
    here = graph.xyz[branch.point : graph.last[branch.lane] + 1, :2]
    for lane in graph.neighbors.get(branch.lane, ()):
        there = graph.xyz[graph.first[lane] : graph.last[lane] + 1, :2]
        entry = int(np.argmin(np.sum((there - here[0]) ** 2, axis=-1)))
        leave = int(np.argmin(np.sum((here - there[entry]) ** 2, axis=-1)))
        if entry == len(there) - 1:
            continue
        point, leave = graph.first[lane] + entry, branch.point + leave
        length = branch.length + graph.station[leave] - graph.station[branch.point]
        pieces = branch.pieces
        if length > 0:
            pieces = (*pieces, (branch.point, leave))
            target = graph.station[point] + CHANGE_LENGTH
            beside = int(np.searchsorted(graph.station, target))
            point = min(beside, graph.last[lane])
        elif entry > 0:  # at the start: begin at or behind the ego
            point -= 1
        found.append(_Branch(0, length, 0, lane, point, pieces, True))
    return found


def _distance(graph: LaneGraph, lane: int, log: Float[np.ndarray, "steps 3"]) -> float:
    """Returns how far the middle and the end of a lane are from the log, on average."""
    first, last = graph.first[lane], graph.last[lane]
    gap = graph.xyz[[(first + last) // 2, last], None, :2] - log[None, :, :2]
    return float(np.sqrt(np.sum(gap**2, axis=-1).min(axis=1)).mean())


def _path(
    graph: LaneGraph,
    pieces: tuple[tuple[int, int], ...],
    position: Float[np.ndarray, " 3"],
    length: float,
) -> Float[np.ndarray, "points 4"]:
    """Returns the points of a way from beside `position` on.

    It begins where the position projects onto its first edges, and is prolonged back if
    it begins ahead. The fourth column is the speed limit there [m/s], 0 where none is
    known.
    """
    runs = [np.arange(first, last + 1) for first, last in pieces]
    points = np.concatenate(runs)
    xyz, limit = graph.xyz[points], graph.limit[points]
    edge = np.diff(xyz[: FIRST_EDGES + 1], axis=0)
    if len(edge):
        offset = (position - xyz[: len(edge)])[:, :2]
        squared = np.maximum(np.sum(edge[:, :2] ** 2, axis=1), 1e-9)
        along = np.minimum(np.sum(offset * edge[:, :2], axis=1) / squared, 1.0)
        along[1:] = np.maximum(along[1:], 0.0)
        gap = offset - along[:, None] * edge[:, :2]
        nearest = int(np.argmin(np.sum(gap**2, axis=1)))
        start = xyz[nearest] + along[nearest] * edge[nearest]
        begin = nearest + (along[nearest] >= 0)
        xyz = np.concatenate([start[None], xyz[begin:]])
        limit = np.concatenate([limit[nearest : nearest + 1], limit[begin:]])
    samples = _resample(xyz, SPACING, length)
    at = np.searchsorted(stations(xyz), SPACING * np.arange(len(samples)), "right") - 1
    return np.concatenate([samples, limit[at, None]], axis=1)


def _distinct(
    paths: list[Float[np.ndarray, "_ 4"]],
) -> list[Float[np.ndarray, "_ 4"]]:
    """Drops the paths that equal another or its beginning, to a centimetre."""
    texts = [np.round(path, 2).tobytes() for path in paths]
    return [
        path
        for i, (path, text) in enumerate(zip(paths, texts, strict=True))
        if not any(
            other.startswith(text) and (len(other) > len(text) or j < i)
            for j, other in enumerate(texts)
            if j != i
        )
    ]


def _on_route(
    paths: list[Float[np.ndarray, "_ 4"]],
    log: Float[np.ndarray, "steps 3"],
    end: Float[np.ndarray, " 3"],
    yaw: float,
) -> Bool[np.ndarray, " paths"]:
    """Tells which paths follow the log; `with_paths` states the rule."""
    heading = np.array([np.cos(yaw), np.sin(yaw)])
    positions = np.concatenate([log, end[None]])[:, :2] - end[:2]
    result = np.zeros(len(paths), bool)
    for i, path in enumerate(paths):
        xy = path[:, :2] - end[:2]
        squared = np.sum(xy**2, axis=1)[:, None] - 2 * (xy @ positions.T)
        squared = squared.min(axis=0) + np.sum(positions**2, axis=1)
        near = squared <= FOLLOW_DISTANCE**2
        at = min(int(np.argmin(np.sum(xy**2, axis=1))), len(xy) - 2)
        same_way = (xy[at + 1] - xy[at]) @ heading > 0 if len(xy) > 1 else True
        result[i] = near[-1] and near[:-1].mean() >= FOLLOW_SHARE and same_way
    return result


def _spaced(xyz: Float[np.ndarray, "steps 3"]) -> Float[np.ndarray, "points 3"]:
    """Keeps positions 0.5 m apart, so that the jitter of a parked car is no way."""
    kept = [xyz[0]]
    for point in xyz[1:]:
        if np.hypot(*(point - kept[-1])[:2]) >= SPACING:
            kept.append(point)
    return np.stack(kept)


def _resample(
    xyz: Float[np.ndarray, "points 3"], spacing: float, length: float = np.inf
) -> Float[np.ndarray, "samples 3"]:
    """Returns points that are `spacing` apart, up to `length` or the last that fits."""
    station = stations(xyz)
    samples = np.arange(0.0, min(station[-1], length) + 1e-9, spacing)
    return np.stack([np.interp(samples, station, xyz[:, i]) for i in range(3)], axis=-1)
