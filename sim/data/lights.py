"""Finds which way traffic leads where a traffic light stops it."""

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import LANES, Lights, Polylines

# Stop points lie on their lanes. Farther away [m], the lane has the light's number by
# chance: some files number their map anew.
SAME_PLACE = 2.0


def seen_lights(lights: Lights) -> Lights:
    """Leaves out lights that were never seen: they have no place."""
    seen = lights.valid.any(axis=1)
    return Lights(
        lane_id=lights.lane_id[seen],
        xyz=lights.xyz[seen],
        state=lights.state[seen],
        valid=lights.valid[seen],
    )


def lane_directions(
    lights: Lights, roads: Polylines
) -> tuple[Float[np.ndarray, " lights"], Bool[np.ndarray, " lights"]]:
    """Returns the direction of each light's lane at the stop point [rad].

    It is that of the piece of the lane nearest to the stop point; of two equally near
    ones, the first.

    Returns:
        The direction, zero where not known, and whether the map has the lane.
    """
    yaw, has_lane = np.zeros(len(lights.lane_id)), np.zeros(len(lights.lane_id), bool)
    lanes = np.flatnonzero(np.isin(roads.map_type, LANES))
    lane_of = {int(roads.feature_id[lane]): int(lane) for lane in lanes}
    for i, lane_id in enumerate(lights.lane_id.tolist()):
        if lane_id not in lane_of:
            continue
        xy = roads.points_of(lane_of[lane_id])[:, :2]
        xy = xy[np.append(True, (xy[1:] != xy[:-1]).any(axis=1))]
        if len(xy) < 2:
            continue
        along, offset = np.diff(xy, axis=0), lights.xyz[i, :2] - xy[:-1]
        share = (offset * along).sum(axis=1) / (along**2).sum(axis=1)
        rest = offset - np.clip(share, 0, 1)[:, None] * along
        distance = np.hypot(rest[:, 0], rest[:, 1])
        nearest = distance.argmin()
        has_lane[i] = distance[nearest] <= SAME_PLACE
        yaw[i] = np.arctan2(*along[nearest, ::-1]) if has_lane[i] else 0.0
    return yaw, has_lane
