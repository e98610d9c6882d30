"""Finds where the lanes of a town cross or run into each other."""

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float, Int

from .lines import Line, stations
from .piece import Piece
from .town import Town

CLOSE = 2.7  # metres between the middles of lanes that cars cannot use side by side
SAMPLES = 24  # points of a lane that are compared with those of others
Span = tuple[float, float]  # begin and end [m]
Meeting = tuple[int, int, list[Span]]  # two lanes and their stretches

LONGEST = 1500  # points from the end of two lanes that run into one


@dataclasses.dataclass(frozen=True, kw_only=True)
class Zones:
    """Stretches of two lanes on which one car at a time has room.

    Zone i has the sides 2 i and 2 i + 1, one on each of its lanes.
    """

    lane: Int[np.ndarray, " sides"]
    begin: Float[np.ndarray, " sides"]  # metres along the lane
    end: Float[np.ndarray, " sides"]
    yields: Int[np.ndarray, " sides"]  # 1 to the other side, 0 who is first, -1 not


def zones(town: Town) -> Zones:
    """Returns the zones of all pieces."""
    rows: list[tuple[int, float, float, int]] = []
    following = set(town.successor)
    origins = _grouped((b, a) for a, b in town.successor)
    targets = _grouped(town.successor)
    for base, piece in zip(town.first_lane.tolist(), town.pieces, strict=True):
        found = (
            _merging(piece, base, targets)
            if piece.kind in ("road", "ramp", "carpark")
            else _crossing(piece)
        )
        for a, b, spans in found:
            i, j = base + a, base + b
            if {(i, j), (j, i)} & following or origins.get(i, {-1}) & origins.get(
                j, {-2}
            ):
                continue
            rank = piece.lanes[a].rank - piece.lanes[b].rank
            rows.append((i, *spans[0], int(np.sign(-rank))))
            rows.append((j, *spans[1], int(np.sign(rank))))
    lane, begin, end, yields = zip(*rows, strict=True) if rows else ((),) * 4
    return Zones(
        lane=np.array(lane, int),
        begin=np.array(begin, float),
        end=np.array(end, float),
        yields=np.array(yields, int),
    )


def _crossing(piece: Piece) -> Iterator[Meeting]:
    """Yields pairs of lanes that come close, with the stretches where they do [m]."""
    num = len(piece.lanes)
    station = [stations(lane.line) for lane in piece.lanes]
    share = np.linspace(0.0, 1.0, SAMPLES)
    xy = np.empty((num, SAMPLES, 2))
    for i, lane in enumerate(piece.lanes):
        places = share * station[i][-1]
        for axis in range(2):
            xy[i, :, axis] = np.interp(places, station[i], lane.line[:, axis])
    gap = xy[:, :, None, None] - xy[None, None]
    close = gap[..., 0] ** 2 + gap[..., 1] ** 2 < CLOSE**2
    mine = np.asarray(close.any(axis=3))  # lane, sample, other lane
    length = np.array([s[-1] for s in station])[:, None]
    cell = length / (SAMPLES - 1)
    begin = np.maximum((np.argmax(mine, axis=1) - 0.5) * cell, 0.0)
    last = SAMPLES - 1 - np.argmax(mine[:, ::-1], axis=1)
    end = np.minimum((last + 0.5) * cell, length)
    meet = np.argwhere(np.triu(np.asarray(mine.any(axis=1)), 1))
    for i, j in meet.tolist():
        yield (
            i,
            j,
            [
                (float(begin[i, j]), float(end[i, j])),
                (float(begin[j, i]), float(end[j, i])),
            ],
        )


def _merging(
    piece: Piece, base: int, targets: dict[int, set[int]]
) -> Iterator[Meeting]:
    """Yields pairs of lanes with a common successor, as `_crossing` does."""
    num = len(piece.lanes)
    for i in range(num):
        for j in range(i + 1, num):
            if targets.get(base + i, {-1}) & targets.get(base + j, {-2}):
                a, b = piece.lanes[i].line, piece.lanes[j].line
                yield i, j, [_close_end(a, b), _close_end(b, a)]


def _close_end(line: Line, other: Line) -> tuple[float, float]:
    """Returns the stretch up to a line's end on which another is close."""
    num = min(len(line), len(other), LONGEST)
    gap = line[::-1][:num] - other[::-1][:num]
    apart = gap[:, 0] ** 2 + gap[:, 1] ** 2 > CLOSE**2
    first = int(np.argmax(apart)) if apart.any() else num - 1
    station = stations(line)
    return float(station[len(line) - 1 - first]), float(station[-1])


def _grouped(pairs: Iterable[tuple[int, int]]) -> dict[int, set[int]]:
    groups: dict[int, set[int]] = {}
    for a, b in pairs:
        groups.setdefault(a, set()).add(b)
    return groups
