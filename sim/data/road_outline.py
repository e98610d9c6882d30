"""Finds the edges of a road from the areas that make it up.

Maps that list surfaces instead of edges (drivable areas, lanes between two bounds) come
through here.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from jaxtyping import Bool, Float

from ..scenario import ScenarioError

GAP = 0.25  # metres: areas nearer than twice this to each other belong together
OPENING_REACH = 0.3  # metres from an opening to the outline that it opens
OPENING_LENGTH = 1.0  # metres of a segment along openings, beyond which it is open
MIN_AREA = 2.0  # square metres: smaller islands are seams between areas
DETAIL = 0.01  # metres that the outline may leave the areas
MIN_RUN = 0.5  # metres: shorter edges between openings are remains of them
MAX_POINTS = 200_000
MAX_CROSSINGS = 30  # of a side with others, its neighbours too; real maps have up to 11
MAX_SELF_CROSSINGS = 5  # of a side with those of its own area; 3 where none crosses
_FEW_CROSSINGS = 1000  # in all that even a small map may have
_PAIRS_AT_ONCE = 10**6


def edges(
    areas: Sequence[Float[np.ndarray, "_ 3"]],
    openings: Sequence[Float[np.ndarray, "2 3"]],
) -> tuple[list[Float[np.ndarray, "_ 3"]], list[Float[np.ndarray, "_ 3"]]]:
    """Returns the edges of the union of areas, with the road on their left.

    Areas that touch, overlap or lie within half a metre of each other become one road
    without edges between them, also where they lie at different heights: of two roads
    that cross at two levels, the edges are lost where they cross. Where the outline
    follows an opening it is left out, from corner to corner.

    Args:
        areas: rings of points, in either sense, closed or not [m].
        openings: lines across the road where the map ends and the road goes on [m].

    Returns:
        The boundaries and the edges of islands. Those without openings are closed.

    Raises:
        ScenarioError: if the areas are too large or too tangled to be those of a map.
    """
    areas = [area for area in areas if len(area) >= 3]
    if not areas:
        return [], []
    points = np.concatenate(areas)
    _check([*areas, *openings])
    try:
        road = _union(areas)
        outer = [polygon.exterior for polygon in road]
        islands = [
            ring
            for polygon in road
            for ring in polygon.interiors
            if shapely.Polygon(ring).area >= MIN_AREA
        ]
        zone = _zone(openings)
        return _runs(outer, zone, points), _runs(islands, zone, points)
    except shapely.errors.GEOSException as error:
        raise ScenarioError(f"the areas of the road make no shape ({error})") from error


def _check(areas: Sequence[Float[np.ndarray, "_ 3"]]) -> None:
    """Raises ScenarioError for areas on which a union would take too much."""
    points = np.concatenate(areas)
    if not (np.abs(points) < 1e7).all():
        raise ScenarioError("a point of the road is not a finite number of metres")
    if len(points) > MAX_POINTS:
        raise ScenarioError(
            f"the areas of the road have {len(points)} points, at most {MAX_POINTS} "
            "are read; cut the map"
        )
    following = np.concatenate([np.roll(area, -1, axis=0) for area in areas])
    sides = _segments(points[:, :2], following[:, :2])
    area_of = np.repeat(np.arange(len(areas)), [len(area) for area in areas])
    tree = shapely.STRtree(sides)
    num_crossings = num_own = first = 0
    for part in np.array_split(sides, 1 + len(sides) ** 2 // _PAIRS_AT_ONCE):
        side, other = tree.query(part, predicate="intersects")
        num_crossings += len(other)
        num_own += int(np.sum(area_of[first + side] == area_of[other]))
        first += len(part)
        if (
            num_crossings > MAX_CROSSINGS * len(sides) + _FEW_CROSSINGS
            or num_own > MAX_SELF_CROSSINGS * len(sides) + _FEW_CROSSINGS
        ):
            raise ScenarioError(
                f"the {len(sides)} sides of the areas of the road cross too often: "
                "their points are out of order"
            )


def _union(areas: Sequence[Float[np.ndarray, "_ 3"]]) -> list[shapely.Polygon]:
    """Returns the polygons that the areas make, outer rings anticlockwise."""
    # The other method takes 20 s for a ring of 300 points in random order.
    polygons = shapely.make_valid(
        [shapely.Polygon(area[:, :2]) for area in areas],
        method="structure",
        keep_collapsed=False,
    )
    grown = shapely.buffer(polygons, GAP, join_style="mitre")
    union = shapely.union_all(grown).buffer(-GAP, join_style="mitre").simplify(DETAIL)
    parts = [part for part in shapely.get_parts(union) if part.area >= MIN_AREA]
    return [shapely.geometry.polygon.orient(part) for part in parts]


def _zone(openings: Sequence[Float[np.ndarray, "2 3"]]) -> shapely.STRtree:
    """Returns what lies along the openings, as polygons that share no area."""
    lines = shapely.linestrings(np.array(openings).reshape(-1, 2, 3)[..., :2])
    along = shapely.union_all(shapely.buffer(lines, OPENING_REACH, cap_style="flat"))
    return shapely.STRtree(shapely.get_parts(along))


def _runs(
    rings: Sequence[shapely.Geometry],
    zone: shapely.STRtree,
    points: Float[np.ndarray, "points 3"],
) -> list[Float[np.ndarray, "_ 3"]]:
    """Returns what remains of rings, at the heights of the nearest points."""
    tree = shapely.STRtree(np.asarray(shapely.points(points[:, :2])))
    found = []
    for ring in rings:
        for run in _opened(shapely.get_coordinates(ring), zone):
            nearest = tree.nearest(shapely.points(run))
            found.append(np.concatenate([run, points[nearest, 2:]], axis=1))
    return found


def _opened(
    ring: Float[np.ndarray, "points 2"], zone: shapely.STRtree
) -> list[Float[np.ndarray, "_ 2"]]:
    """Returns the runs of a closed ring that remain without its open segments."""
    is_open = _is_open(ring, zone)
    if not is_open.any():
        return [ring]
    # Begun at an open segment, no run passes the place where the ring is joined.
    first = int(is_open.argmax())
    ring = np.roll(ring[:-1], -first, axis=0)
    ring = np.concatenate([ring, ring[:1]])
    change = np.diff(np.append(np.roll(is_open, -first), True).astype(int))
    start, stop = np.flatnonzero(change == -1) + 1, np.flatnonzero(change == 1) + 1
    runs = [ring[a : b + 1] for a, b in zip(start, stop, strict=True)]
    return [run for run in runs if shapely.LineString(run).length >= MIN_RUN]


def _is_open(
    ring: Float[np.ndarray, "points 2"], zone: shapely.STRtree
) -> Bool[np.ndarray, " segments"]:
    segments = _segments(ring[:-1], ring[1:])
    length = shapely.length(segments)
    # A map of kilometres has thousands of openings, of which few are near a segment.
    near, opening = zone.query(segments, predicate="intersects")
    shared = shapely.intersection(segments[near], zone.geometries[opening])
    along = np.bincount(near, shapely.length(shared), len(segments))
    return (along > 0) & (along >= np.minimum(OPENING_LENGTH, length / 2))


def _segments(
    start: Float[np.ndarray, "segments 2"], end: Float[np.ndarray, "segments 2"]
) -> np.ndarray:
    return np.asarray(shapely.linestrings(np.stack([start, end], axis=1)))
