"""Measures how traffic in scenarios behaves, so that two sources can be compared."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import ObjectType
from .entry import entry_of
from .packed import Packed
from .planar_log import PlanarLog, planar_log

EVERY = 10  # steps of the log between samples
SPAN = 5  # steps over which an acceleration is meant
MOVING = 1.0  # metres per second
LONGEST_HEADWAY = 6.0  # seconds: beyond, nobody is followed
LANE_SIDE = 1.5  # metres beside the own middle line within which one is followed
SAME_WAY = np.cos(np.radians(30.0))

QUANTITIES = {
    "ego_speed": "speed of the ego [m/s]",
    "speed": "speed of moving vehicles [m/s]",
    "acceleration": "acceleration of moving vehicles [m/s²]",
    "headway": "headway to the one followed [s]",
    "objects": "objects per scene",
    "still": "share of objects that stand throughout",
    "at_junction": "share of egos that pass a junction",
    "standing": "share of egos that stay where they are",
}

Samples = Mapping[str, Float[np.ndarray, " samples"]]


def samples(scenarios: Sequence[Packed]) -> Samples:
    """Returns samples of each of the `QUANTITIES` over all scenarios."""
    each = [_samples(packed) for packed in scenarios]
    return {name: np.concatenate([one[name] for one in each]) for name in QUANTITIES}


def distance(
    one: Float[np.ndarray, " samples"], other: Float[np.ndarray, " others"]
) -> float:
    """Returns the greatest difference of two distribution functions, from 0 to 1.

    It is the statistic of Kolmogorov and Smirnov; of shares, their difference. NaN if
    there is no sample.
    """
    if not len(one) or not len(other):
        return float("nan")
    at = np.concatenate([one, other])
    shares = [
        np.searchsorted(np.sort(values), at, side="right") / len(values)
        for values in (one, other)
    ]
    return float(np.abs(shares[0] - shares[1]).max())


def _samples(packed: Packed) -> Samples:
    log, entry = planar_log(packed), entry_of(packed)
    speed = np.linalg.norm(log.velocity, axis=-1)
    steps = np.arange(0, packed.num_steps, EVERY)
    vehicle = packed.object_type == ObjectType.VEHICLE
    moving = log.valid & (speed > MOVING) & vehicle[:, None]

    def alone(value: float | int) -> Float[np.ndarray, " one"]:
        return np.array([value], np.float64)

    return {
        "ego_speed": speed[0, steps][log.valid[0, steps]],
        "speed": speed[:, steps][moving[:, steps]],
        "acceleration": _accelerations(speed, moving, steps),
        "headway": _headways(log, packed, moving, steps),
        "objects": alone(entry.num_objects),
        "still": alone(entry.num_still / entry.num_objects),
        "at_junction": alone(entry.is_at_junction),
        "standing": alone(entry.ego_distance <= MOVING),
    }


def _accelerations(
    speed: Float[np.ndarray, "objects steps"],
    moving: Bool[np.ndarray, "objects steps"],
    steps: np.ndarray,
) -> Float[np.ndarray, " samples"]:
    first = steps[steps + SPAN < speed.shape[1]]
    both = moving[:, first] & moving[:, first + SPAN]
    change = (speed[:, first + SPAN] - speed[:, first]) / (0.1 * SPAN)
    return change[both]


def _headways(
    log: PlanarLog,
    packed: Packed,
    moving: Bool[np.ndarray, "objects steps"],
    steps: np.ndarray,
) -> Float[np.ndarray, " samples"]:
    """Returns the time to the rear of the vehicle ahead on the same line, where near.

    Lines are straight along the yaw, which is short-sighted in bends for every source.
    """
    vehicle = np.flatnonzero(packed.object_type == ObjectType.VEHICLE)
    half = packed.object_size[vehicle, 0] / 2
    found = []
    for step in steps:
        follows = moving[vehicle, step]
        there = log.valid[vehicle, step]
        yaw = log.yaw[vehicle, step]
        ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        offset = log.xy[vehicle, step][None] - log.xy[vehicle, step][:, None]
        along = (offset * ahead[:, None]).sum(axis=-1)
        across = offset[..., 1] * ahead[:, None, 0] - offset[..., 0] * ahead[:, None, 1]
        same_way = (ahead[:, None] * ahead[None]).sum(axis=-1) > SAME_WAY
        gap = along - half[:, None] - half[None]
        is_ahead = there[None] & same_way & (np.abs(across) < LANE_SIDE) & (along > 0)
        np.fill_diagonal(is_ahead, False)
        speed = np.linalg.norm(log.velocity[vehicle, step], axis=-1)
        nearest = np.where(is_ahead, gap, np.inf).min(axis=1, initial=np.inf)
        time = nearest[follows] / speed[follows]
        found.append(time[(time >= 0) & (time <= LONGEST_HEADWAY)])
    return np.concatenate(found)
