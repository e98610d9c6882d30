"""Says on which side of a road edge the road lies, at its vertices."""

import numpy as np
from jaxtyping import Bool, Float

SAME_PLACE = 0.01  # metres to which places are rounded before they are compared


def normals(
    edges: Float[np.ndarray, "vertices 3"], joined: Bool[np.ndarray, " vertices"]
) -> Float[np.ndarray, " vertices"]:
    """Returns the direction from each edge vertex towards the road [rad].

    It is the mean of the left normals of all edge segments that end in the place of the
    vertex, whichever edge they belong to: maps break edges into pieces.

    Args:
        edges: vertices of all edges, one after the other [m].
        joined: whether a segment leads from the vertex to the next one.
    """
    if not len(edges):
        return np.zeros(0)
    start = np.flatnonzero(joined)
    along = edges[start + 1, :2] - edges[start, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.where(
        length > 0, length, 1
    )
    _, place = np.unique(np.round(edges / SAME_PLACE), axis=0, return_inverse=True)
    total = np.zeros((place.max() + 1, 2))
    np.add.at(total, place[start], left)
    np.add.at(total, place[start + 1], left)
    folded = np.linalg.norm(total, axis=1) < 1e-6  # an edge that turns back on itself
    total[place[start[folded[place[start]]]]] = left[folded[place[start]]]
    return np.arctan2(total[place, 1], total[place, 0])
