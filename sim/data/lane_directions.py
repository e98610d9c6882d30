"""Finds which way traffic leads where a traffic light or a stop sign stops it."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..scenario import LANES, LaneLinks, MapType, Polylines

# Stop points lie on their lanes. Farther away [m], the lane has the light's number by
# chance: some files number their map anew. Signs stand beside the road.
SAME_PLACE = 2.0
BESIDE = 15.0

Directions = tuple[Float[np.ndarray, " places"], Bool[np.ndarray, " places"]]


def lane_directions(
    lane_id: Int[np.ndarray, " places"],
    xyz: Float[np.ndarray, "places 3"],
    roads: Polylines,
    within: float = SAME_PLACE,
) -> Directions:
    """Returns the direction of a lane at each place [rad].

    It is that of the piece of the lane nearest to the place; of two equally near ones,
    the first.

    Args:
        lane_id: the lane of each place.
        xyz: the places [m].
        roads: the map.
        within: how far a place may be from its lane [m].

    Returns:
        The direction, zero where not known, and whether the map has the lane there.
    """
    yaw, has_lane = np.zeros(len(lane_id)), np.zeros(len(lane_id), bool)
    lanes = np.flatnonzero(np.isin(roads.map_type, LANES))
    lane_of = {int(roads.feature_id[lane]): int(lane) for lane in lanes}
    for i, name in enumerate(lane_id.tolist()):
        if name not in lane_of:
            continue
        xy = roads.points_of(lane_of[name])[:, :2]
        xy = xy[np.append(True, (xy[1:] != xy[:-1]).any(axis=1))]
        if len(xy) < 2:
            continue
        along, offset = np.diff(xy, axis=0), xyz[i, :2] - xy[:-1]
        share = (offset * along).sum(axis=1) / (along**2).sum(axis=1)
        rest = offset - np.clip(share, 0, 1)[:, None] * along
        distance = np.hypot(rest[:, 0], rest[:, 1])
        nearest = distance.argmin()
        has_lane[i] = distance[nearest] <= within
        yaw[i] = np.arctan2(*along[nearest, ::-1]) if has_lane[i] else 0.0
    return yaw, has_lane


def stop_sign_directions(roads: Polylines, links: LaneLinks | None) -> Directions:
    """Returns the direction of the first lane that each stop sign stops [rad].

    Args:
        roads: the map; its stop signs are runs of one point.
        links: which sign stops which lanes; None where the format does not say.

    Returns:
        The direction, zero where not known, and whether it is known.
    """
    signs = np.flatnonzero(roads.map_type == MapType.STOP_SIGN)
    yaw, is_known = np.zeros(len(signs)), np.zeros(len(signs), bool)
    if links is None or not len(links.stop):
        return yaw, is_known
    named, first = np.unique(links.stop[:, 0], return_index=True)
    lane_of = dict(zip(named.tolist(), links.stop[first, 1].tolist(), strict=True))
    stops = np.isin(roads.feature_id[signs], named)
    lanes = [lane_of[name] for name in roads.feature_id[signs[stops]].tolist()]
    places = roads.xyz[roads.offset[signs[stops]]]
    yaw[stops], is_known[stops] = lane_directions(
        np.array(lanes, np.int64), places, roads, BESIDE
    )
    return yaw, is_known
