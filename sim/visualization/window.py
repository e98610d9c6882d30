"""States which part of the map a picture shows, and at what scale."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

MARGIN = 4.0  # metres: what lies this far outside may still reach in


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """The square of the map that a picture shows."""

    center: Float[np.ndarray, " 2"]  # metres
    radius: float  # metres from the centre to each side
    points_per_metre: float  # of the picture; a point is 1/72 inch

    def meets(self, points: Float[np.ndarray, "points 2"]) -> bool:
        """Whether the bounding box of some points meets the window, or nearly."""
        distance = np.maximum(
            points.min(axis=0) - self.center, self.center - points.max(axis=0)
        )
        return bool((distance < self.radius + MARGIN).all())

    def contains(
        self, points: Float[np.ndarray, "points 2"]
    ) -> Bool[np.ndarray, " points"]:
        """Whether each point lies in the window."""
        is_near = np.abs(points - self.center) < self.radius
        return is_near[:, 0] & is_near[:, 1]
