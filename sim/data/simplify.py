"""Simplifies polylines, all of a scenario at once."""

import numpy as np
from jaxtyping import Bool, Float, Int


def kept_points(
    xyz: Float[np.ndarray, "points 3"],
    offset: Int[np.ndarray, " features_plus_1"],
    tolerance: float,
    longest: float = np.inf,
    always: Bool[np.ndarray, " points"] | bool = False,
) -> Bool[np.ndarray, " points"]:
    """Marks the points that the simplified polylines keep.

    Douglas and Peucker (1973): between two kept points the one farthest from the chord
    is kept too if it lies beyond the tolerance. All polylines are refined together, one
    round for each level of the recursion.

    Args:
        xyz: points of all polylines, one after the other [m].
        offset: first point of each polyline, and the number of points; none is empty.
        tolerance: the greatest distance from a dropped point to its chord [m].
        longest: a point is kept at least this often along a polyline [m], as far as
            it has points.
        always: points to keep whatever their place.

    Returns:
        True for kept points; the ends of each polyline always are.
    """
    kept = np.zeros(len(xyz), bool) | always
    kept[offset[:-1]] = True
    kept[offset[1:] - 1] = True
    arc = np.cumsum(np.linalg.norm(np.diff(xyz, axis=0, prepend=xyz[:1]), axis=1))
    arc -= np.repeat(arc[offset[:-1]], np.diff(offset))
    kept[1:] |= arc[1:] // longest > arc[:-1] // longest
    open_points = np.flatnonzero(~kept)
    while len(open_points):
        kept_index = np.flatnonzero(kept)
        chord = np.searchsorted(kept_index, open_points) - 1
        start, end = xyz[kept_index[chord]], xyz[kept_index[chord + 1]]
        distance = _distance_to_segment(xyz[open_points], start, end)
        first = np.flatnonzero(np.diff(chord, prepend=-1))
        farthest = np.maximum.reduceat(distance, first)
        counts = np.diff(first, append=len(chord))
        split = np.repeat(farthest > tolerance, counts)
        kept[open_points[split & (distance == np.repeat(farthest, counts))]] = True
        open_points = open_points[split & ~kept[open_points]]
    return kept


def _distance_to_segment(point, start, end):
    along = end - start
    squared = np.einsum("pc,pc->p", along, along)
    share = np.einsum("pc,pc->p", point - start, along) / np.where(
        squared > 0, squared, 1
    )
    nearest = start + np.clip(share, 0, 1)[:, None] * along
    return np.linalg.norm(point - nearest, axis=1)
