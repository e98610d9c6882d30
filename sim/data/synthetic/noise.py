"""Adds to a log what perception adds: errors that change slowly.

What stands keeps its error, so that parked cars are exactly constant, as in WOMD.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...scenario import DT, ObjectType
from .lines import snap
from .log import PlanarTracks

SIGMA = (0.05, 0.05, 0.012)  # metres, metres and radians, before smoothing
MEMORY = 7.0  # metres of travel in which an error changes
MEMORY_ON_FOOT = 1.0  # metres
HUMP = 2.6  # standard deviations that no error exceeds


def perceived(generator: np.random.Generator, tracks: PlanarTracks) -> PlanarTracks:
    """Returns the tracks as others see them; the first, the ego, knows where it is.

    An error follows another one, with a lag, that forgets itself (two filters of first
    order); both run by the distance travelled instead of time.
    """
    travelled = DT * np.sqrt(
        tracks.velocity[..., 0] ** 2 + tracks.velocity[..., 1] ** 2
    )
    on_foot = tracks.object_type == ObjectType.PEDESTRIAN
    memory = np.where(on_foot, MEMORY_ON_FOOT, MEMORY)
    keep = memory[:, None] / (memory[:, None] + travelled)
    shocks = generator.normal(size=(*keep.shape, 3)).clip(-HUMP, HUMP)
    error = snap(_smooth(keep, shocks * np.array(SIGMA)))
    error[0] = 0.0
    drift = np.diff(error, axis=1, append=error[:, -1:]) / DT
    return dataclasses.replace(
        tracks,
        xy=tracks.xy + error[..., :2],
        yaw=tracks.yaw + error[..., 2],
        velocity=snap(tracks.velocity + drift[..., :2]),
    )


def _smooth(
    keep: Float[np.ndarray, "objects steps"],
    shocks: Float[np.ndarray, "objects steps 3"],
) -> Float[np.ndarray, "objects steps 3"]:
    first = shocks[:, 0]
    second = np.zeros_like(first)
    errors = [second]
    renewal = np.sqrt(1 - keep**2)
    for t in range(1, keep.shape[1]):
        k = keep[:, t, None]
        first = k * first + renewal[:, t, None] * shocks[:, t]
        second = k * second + (1 - k) * first
        errors.append(second)
    return np.stack(errors, axis=1)
