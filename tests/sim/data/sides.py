"""Tells on which side of the road edges the ego of a scenario drives, for tests."""

import numpy as np

from drivetrain.sim.scenario import EDGES, Scenario


def share_left_of_edges(found: Scenario) -> float:
    """Returns for which share of its steps the ego is left of the nearest edge.

    Of segments that are equally near, because they share the nearest point, the one
    counts that is less in line with the ego.
    """
    starts, ends = [], []
    for feature in np.flatnonzero(np.isin(found.roads.map_type, EDGES)):
        xy = found.roads.points_of(int(feature))[:, :2]
        starts.append(xy[:-1])
        ends.append(xy[1:])
    start, along = np.concatenate(starts), np.concatenate(ends) - np.concatenate(starts)
    start, along = start[along.any(axis=1)], along[along.any(axis=1)]
    ego = found.tracks.xyz[found.ego_index, found.tracks.valid[found.ego_index], :2]
    num_left = 0
    for place in ego:
        offset = place - start
        share = np.clip((offset * along).sum(1) / (along**2).sum(1), 0.0, 1.0)
        rest = offset - share[:, None] * along
        distance = np.hypot(*rest.T)
        side = (along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]) / np.hypot(
            *along.T
        )
        near = np.flatnonzero(distance < distance.min() + 1e-6)
        num_left += side[near[np.abs(side[near]).argmax()]] > 0
    return num_left / len(ego)
