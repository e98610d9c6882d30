"""Chooses whose log it is."""

import numpy as np
from jaxtyping import Bool, Float

from ...scenario import DT, ObjectType
from .log import PlanarTracks

NEAR = 70.0  # metres from the origin
MAX_LENGTH = 5.6  # metres of the ego
MAX_ACCELERATION, MAX_CURVATURE = 5.7, 0.27  # below the limits of the bicycle
ROUNDING = 2.0**-15  # radians by which a car that stands may seem to turn
TURNS = 0.5  # radians
STANDS = 0.5  # metres that one moves at least who does not stand throughout
TURN_WEIGHT, STANDING_WEIGHT = 11.0, 8.0


def choose(
    generator: np.random.Generator,
    tracks: PlanarTracks,
    num_drivers: int,
) -> int | None:
    """Draws the ego among the drivers, or None if nobody qualifies.

    It is a car, there throughout and near the middle of the town, that keeps to
    accelerations and curvatures that a bicycle can follow. Who turns or stays is more
    likely. Whether it touches others is not looked at: those who come within 0.3 m of
    it leave the scenario later (`log.overlaps_earlier`).
    """
    driver = np.arange(len(tracks.object_type)) < num_drivers
    fits = driver & (tracks.object_type == ObjectType.VEHICLE)
    fits &= tracks.valid.all(axis=1) & (tracks.size[:, 0] < MAX_LENGTH)
    fits &= np.sum(tracks.xy[:, 10] ** 2, axis=1) < NEAR**2
    fits &= _is_feasible(tracks)
    if not fits.any():
        return None
    turned = np.abs(tracks.yaw[:, -1] - tracks.yaw[:, 0]) > TURNS
    gap = tracks.xy[:, -1] - tracks.xy[:, 0]
    stays = gap[:, 0] ** 2 + gap[:, 1] ** 2 < STANDS**2
    weight = fits * np.where(turned, TURN_WEIGHT, 1.0)
    weight = weight * np.where(stays, STANDING_WEIGHT, 1.0)
    total = np.cumsum(weight)
    drawn = generator.uniform() * total[-1]
    return int(np.searchsorted(total, drawn, side="right"))


def _is_feasible(tracks: PlanarTracks) -> Bool[np.ndarray, " objects"]:
    speed = np.sqrt(tracks.velocity[..., 0] ** 2 + tracks.velocity[..., 1] ** 2)
    acceleration = np.abs(np.diff(speed, axis=1)) / DT
    distance: Float[np.ndarray, "objects steps"] = (
        (speed[:, 1:] + speed[:, :-1]) / 2 * DT
    )
    turned = np.abs(np.diff(tracks.yaw, axis=1))
    gentle = (acceleration < MAX_ACCELERATION) & (
        turned <= MAX_CURVATURE * distance + ROUNDING
    )
    return np.asarray(gentle.all(axis=1))
