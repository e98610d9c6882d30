"""States what a generated road looks like across."""

import dataclasses

import numpy as np

MPH = 0.44704  # metres per second
BIKE_WIDTH = 1.5  # metres
PARKED_SHOULDER = 2.4  # metres on which cars can park


@dataclasses.dataclass(frozen=True, kw_only=True)
class Profile:
    """A road across, as one sees it who looks along it; traffic keeps right."""

    right: int  # lanes that lead away from the viewer
    left: int  # lanes that come towards the viewer
    lane_width: float  # metres
    shoulder: float  # metres between the outermost lane and the edge
    has_bike_lanes: bool  # on the inner part of the shoulders
    median: float  # metres between the two directions; 0 for a painted line
    limit: float  # metres per second

    def reversed(self) -> "Profile":
        """Returns the profile for one who looks back."""
        return dataclasses.replace(self, right=self.left, left=self.right)

    def lane_offset(self, lane: int) -> float:
        """Returns how far from the middle a lane runs [m]; lane 0 is the inner one."""
        return self.median / 2 + (lane + 0.5) * self.lane_width

    def half_width(self, num_lanes: int) -> float:
        """Returns the distance from the middle to the edge of one direction [m].

        A direction without lanes has its edge beside the painted line.
        """
        if num_lanes == 0:
            return 0.6
        return self.median / 2 + num_lanes * self.lane_width + self.shoulder

    @property
    def is_small(self) -> bool:
        """Whether there is one lane in each direction and no median."""
        return max(self.right, self.left) == 1 and self.median == 0


def draw(generator: np.random.Generator, num_lanes: int) -> Profile:
    """Draws a two-way road with so many lanes in each direction."""
    limits = {1: (25, 30, 30, 35), 2: (35, 40, 45), 3: (45, 45, 50)}[num_lanes]
    shoulder = float(generator.choice([0.4, 1.0, 1.9, 2.6], p=[0.3, 0.25, 0.15, 0.3]))
    has_median = generator.uniform() < (0.0, 0.25, 0.5)[num_lanes - 1]
    width = generator.uniform(1.2, 4.0)
    return Profile(
        right=num_lanes,
        left=num_lanes,
        lane_width=round(generator.uniform(3.2, 3.7), 2),
        shoulder=shoulder,
        has_bike_lanes=bool(shoulder == 1.9 and generator.uniform() < 0.7),
        median=round(width, 2) if has_median else 0.0,
        limit=MPH * float(generator.choice(limits)),
    )
