"""Steers generated drivers: now and then one swerves, and corrects it.

Without errors and their correction a log would not show how to get back to the lane.
"""

import numpy as np
from jaxtyping import Float

from ...scenario import DT
from .lines import snap

SWERVES_PER_STEP = 0.03
SWERVE_STEPS = 5
SWERVE_CURVATURE = 0.025  # 1 / metres, standard deviation
MAX_SWERVE = 0.05  # 1 / metres
MAX_ACCELERATION = 2.0  # metres per second squared aside, in a swerve
STIFFNESS = 0.15  # 1 / metres: errors die out over some 7 m
START = (0.08, 0.01)  # standard deviations of the error [m] and its slope at first


def steer(
    station: Float[np.ndarray, "drivers steps"], generator: np.random.Generator
) -> tuple[Float[np.ndarray, "drivers steps"], Float[np.ndarray, "drivers steps"]]:
    """Returns how far left of its line each driver is [m], and the slope of that.

    Along the line s, the error d follows a critically damped correction of swerves w:

        d'' = -k^2 d - 2 k d' + w(s)

    Args:
        station: along the lines [m].
        generator: draws the swerves.
    """
    num_drivers, num_steps = station.shape
    distance = np.diff(station, axis=1)
    begins = generator.uniform(size=(num_drivers, num_steps)) < SWERVES_PER_STEP
    size = generator.normal(0.0, SWERVE_CURVATURE, (num_drivers, num_steps))
    size *= begins
    swerve = np.sum([np.roll(size, i, axis=1) for i in range(SWERVE_STEPS)], axis=0)
    speed = np.maximum(distance, 1e-3) / DT
    limit = np.minimum(MAX_SWERVE, MAX_ACCELERATION / speed**2)
    swerve = np.clip(swerve[:, :-1], -limit, limit)

    left = np.zeros((num_drivers, num_steps))
    slope = np.zeros((num_drivers, num_steps))
    left[:, 0], slope[:, 0] = (
        snap(generator.normal(0.0, std, num_drivers)) for std in START
    )
    for t in range(num_steps - 1):
        bend = -(STIFFNESS**2) * left[:, t] - 2 * STIFFNESS * slope[:, t] + swerve[:, t]
        left[:, t + 1] = snap(left[:, t] + slope[:, t] * distance[:, t])
        slope[:, t + 1] = snap(slope[:, t] + bend * distance[:, t])
    return left, slope
