"""Lists the pieces of the map by the square tile that their midpoints lie in.

A piece is a segment of a map feature, or a sign; it has the number of the vertex at
which it begins. Whoever seeks the pieces near a place looks at the tiles around it, as
far as pieces reach. Built once per scenario on the host, read by the C++ kernels.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from ..scenario import ScenarioError

TILE = 16.0  # metres
MAX_PIECE = 32.0  # metres; simplified lines keep a point at least this often
MAX_VERTICES = 2**16  # pieces have numbers of 16 bits


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Tiles:
    """The tiles of one scenario, row by row from the corner."""

    corner: Float[np.ndarray, " 2"]  # least x and y [m]
    shape: Int[np.ndarray, " 2"]  # tiles along x and y
    starts: Integer[np.ndarray, " tiles_plus_1"]  # of each tile in `pieces`
    pieces: Integer[np.ndarray, " vertices"]  # tile by tile, then a tail of no meaning
    reach: float  # how far a piece may leave its tile [m]


def build(
    vertices: Float[np.ndarray, "vertices 3"], joined: Bool[np.ndarray, " vertices"]
) -> Tiles:
    """Sorts the pieces of a map into tiles.

    Args:
        vertices: of all features, one after the other [m].
        joined: whether a segment leads from the vertex to the next one.

    Raises:
        ScenarioError: if there are more vertices than pieces have numbers.
    """
    if len(vertices) > MAX_VERTICES:
        raise ScenarioError(
            f"{len(vertices):,} vertices of the map, at most {MAX_VERTICES:,} fit; "
            "cut the map, or simplify it"
        )
    start = vertices[:, :2]
    end = np.where(joined[:, None], np.roll(start, -1, axis=0), start)
    ended = np.append(False, joined[:-1])
    piece = np.flatnonzero(joined | ~ended)
    middle = ((start + end) / 2)[piece]
    corner = np.floor(middle.min(axis=0))
    column, row = np.floor((middle - corner) / TILE).astype(np.int64).T
    shape = np.array([column.max() + 1, row.max() + 1])
    tile = row * shape[0] + column
    order = np.argsort(tile, kind="stable")
    pieces = np.zeros(len(vertices), np.uint16)
    pieces[: len(piece)] = piece[order]
    starts = np.searchsorted(tile[order], np.arange(shape.prod() + 1))
    return Tiles(
        corner=corner.astype(np.float32),
        shape=shape.astype(np.int32),
        starts=starts.astype(np.int32),
        pieces=pieces,
        reach=float(np.linalg.norm(end - start, axis=1).max() / 2),
    )
