"""States what a picture shows of a rollout: where each object is, step by step."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import Scenario


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Where all objects of a scenario are, in the map frame of its file.

    The first row is the scenario's step `start`, so a rollout without history begins at
    the current step. The events may be left out where nobody measured them.
    """

    xy: Float[np.ndarray, "steps objects 2"]  # metres
    yaw: Float[np.ndarray, "steps objects"]  # radians
    valid: Bool[np.ndarray, "steps objects"]
    collision: Bool[np.ndarray, "steps objects"] | None = None
    offroad: Bool[np.ndarray, "steps objects"] | None = None
    start: int = 0


def logged(scenario: Scenario) -> Trajectory:
    """Returns what the log says of every object."""
    tracks = scenario.tracks
    return Trajectory(
        xy=tracks.xyz[..., :2].swapaxes(0, 1),
        yaw=tracks.yaw.T,
        valid=tracks.valid.T,
    )
