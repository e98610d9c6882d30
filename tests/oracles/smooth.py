"""Oracle of the smooth costs, for one object, in float64."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from . import geometry, metrics
from .geometry import Box


def soften(length: float, softness: float) -> float:
    """Returns s log(1 + exp(x / s)) of a length x [m]."""
    return softness * math.log1p(math.exp(length / softness))


def depth(a: Box, b: Box) -> float:
    """Returns how far two boxes reach into each other, negative where apart [m].

    It is the least overlap of their shadows on the directions of their sides.
    """
    overlaps = []
    for yaw in (a.yaw, b.yaw):
        for axis in (geometry.heading(yaw), geometry.left_of(geometry.heading(yaw))):
            of_a, of_b = geometry.corners(a) @ axis, geometry.corners(b) @ axis
            overlaps += [of_a.max() - of_b.min(), of_b.max() - of_a.min()]
    return min(overlaps)


def collision(box: Box, others: Sequence[Box], softness: float) -> float:
    """Returns the sum of the softened depths of a box in all others [m]."""
    return sum(soften(depth(box, other), softness) for other in others)


def offroad(
    box: Box, z: float, edges: Sequence[Float[np.ndarray, "points 3"]], softness: float
) -> float:
    """Returns the softened distance off the road of the farthest corner [m]."""
    farthest = max(
        metrics.signed_distance(np.append(corner, z), edges)
        for corner in geometry.corners(box)
    )
    return soften(farthest, softness)
