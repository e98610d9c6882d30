"""Lays the driving lanes of a map out as a graph."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float, Int

from ..scenario import DRIVING_LANES, LaneLinks, Polylines

JOIN_DISTANCE = 1.0  # metres between the ends of lanes that follow each other
JOIN_COSINE = np.cos(np.radians(30.0))
ROUNDING = 1e-6  # of a segment: one of just the spacing stays whole
SPACING = 1.0  # metres between the points of a lane, at most
MAX_POINTS = 200_000  # of all lanes, beyond which points lie farther apart


@dataclasses.dataclass(frozen=True)
class LaneGraph:
    """Driving lanes laid end to end; lane i has the points `first[i]` to `last[i]`."""

    xyz: Float[np.ndarray, "points 3"]
    station: Float[np.ndarray, " points"]  # metres, differences hold within a lane
    limit: Float[np.ndarray, " points"]  # speed limit [m/s], 0 where none is known
    first: list[int]
    last: list[int]
    successors: dict[int, list[int]]
    neighbors: dict[int, list[int]]


def lane_graph(roads: Polylines, links: LaneLinks | None) -> LaneGraph:
    """Makes the graph of a map, from its links or, without them, from lane ends.

    Long segments are cut up: some formats keep a straight lane as two points, and ways
    begin, change lanes and end at points.

    Args:
        roads: the map.
        links: what follows and neighbours what; None where the format does not say.
    """
    counts = np.diff(roads.offset)
    is_lane = np.isin(roads.map_type, DRIVING_LANES) & (counts > 0)
    xyz = roads.xyz[np.repeat(is_lane, counts)]
    xyz, counts = _cut_up(xyz, counts[is_lane])
    last = np.cumsum(counts) - 1
    first = last - counts + 1

    limit = np.zeros(len(first))
    if links is None:
        pairs, neighbors = _joined_ends(xyz, first, last), {}
    else:
        lane_of = {int(name): i for i, name in enumerate(roads.feature_id[is_lane])}
        pairs = [
            (lane_of[a], lane_of[b])
            for a, b in links.successor.tolist()
            if a in lane_of and b in lane_of
        ]
        neighbors = _grouped(
            (lane_of[a], lane_of[b])
            for a, b in links.neighbor.tolist()
            if a in lane_of and b in lane_of
        )
        for name, value in zip(links.limited.tolist(), links.limit, strict=True):
            if name in lane_of:
                limit[lane_of[name]] = value
    return LaneGraph(
        xyz=xyz,
        station=stations(xyz),
        limit=np.repeat(limit, last - first + 1),
        first=first.tolist(),
        last=last.tolist(),
        successors=_grouped(pairs),
        neighbors=neighbors,
    )


def _cut_up(
    xyz: Float[np.ndarray, "points 3"], counts: Int[np.ndarray, " lanes"]
) -> tuple[Float[np.ndarray, "more_points 3"], Int[np.ndarray, " lanes"]]:
    """Puts points between those that are far apart; returns them and their counts."""
    if not len(xyz):
        return xyz, counts
    lane = np.repeat(np.arange(len(counts)), counts)
    step = np.diff(xyz, axis=0, append=xyz[-1:])
    length = np.where(np.append(np.diff(lane) == 0, False), np.hypot(*step.T[:2]), 0.0)
    spacing = max(SPACING, float(length.sum()) / MAX_POINTS)
    parts = np.maximum(np.ceil(length / spacing - ROUNDING), 1).astype(np.int64)
    place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    point = np.repeat(np.arange(len(xyz)), parts)
    share = place / parts[point]
    return (
        xyz[point] + share[:, None] * step[point],
        np.bincount(lane[point], minlength=len(counts)),
    )


def _joined_ends(
    xyz: Float[np.ndarray, "points 3"],
    first: Int[np.ndarray, " lanes"],
    last: Int[np.ndarray, " lanes"],
) -> list[tuple[int, int]]:
    """Returns the pairs of lanes of which the first ends where the second begins."""
    lanes = np.flatnonzero(last > first)
    ends, starts = xyz[last[lanes]], xyz[first[lanes]]
    end_direction = _unit(ends[:, :2] - xyz[last[lanes] - 1, :2])
    start_direction = _unit(xyz[first[lanes] + 1, :2] - starts[:, :2])
    gap = ends[:, None] - starts[None]
    # In three dimensions: a bridge does not join the road under it.
    a, b = np.nonzero(np.einsum("abi,abi->ab", gap, gap) <= JOIN_DISTANCE**2)
    joined = np.sum(end_direction[a] * start_direction[b], axis=-1) >= JOIN_COSINE
    return list(zip(lanes[a[joined]].tolist(), lanes[b[joined]].tolist(), strict=True))


def _grouped(pairs: Iterable[tuple[int, int]]) -> dict[int, list[int]]:
    groups: dict[int, list[int]] = {}
    for a, b in pairs:
        if b not in groups.setdefault(a, []):
            groups[a].append(b)
    return groups


def _unit(vector: Float[np.ndarray, "lanes 2"]) -> Float[np.ndarray, "lanes 2"]:
    return vector / np.maximum(np.hypot(vector[:, :1], vector[:, 1:]), 1e-9)


def stations(xyz: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Returns the distance travelled in the plane up to each point."""
    step = np.diff(xyz[:, :2], axis=0)
    return np.append(0.0, np.cumsum(np.hypot(step[:, 0], step[:, 1])))[: len(xyz)]
