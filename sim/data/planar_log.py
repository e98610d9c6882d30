"""Reads the logged motion of a packed scenario back on the host."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from . import log_rows
from .packed import QUANTUM, YAW_QUANTUM, Packed


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PlanarLog:
    """The log of all objects in the plane, in the scenario's frame.

    Where not valid, values are zero.
    """

    xy: Float[np.ndarray, "objects steps 2"]  # metres
    yaw: Float[np.ndarray, "objects steps"]  # radians
    velocity: Float[np.ndarray, "objects steps 2"]  # metres per second
    valid: Bool[np.ndarray, "objects steps"]


def planar_log(packed: Packed) -> PlanarLog:
    """Decodes the log of a packed scenario."""
    valid = log_rows.valid_mask(packed.valid_bits, packed.num_steps)
    counts = valid.sum(axis=1)
    kept = log_rows.kept_rows(packed.is_still, counts)
    row = np.cumsum(kept) - 1  # of each valid step; still objects have one
    poses, turns = packed.poses[row], packed.turns[row].astype(np.float64)
    if packed.turns.dtype == np.int16:
        turns *= [YAW_QUANTUM, QUANTUM, QUANTUM]
    xy, yaw, velocity = (np.zeros((*valid.shape, *tail)) for tail in ((2,), (), (2,)))
    xy[valid] = packed.centre[:2] + packed.quantum * poses[:, :2].astype(np.float64)
    yaw[valid], velocity[valid] = turns[:, 0], turns[:, 1:]
    return PlanarLog(xy=xy, yaw=yaw, velocity=velocity, valid=valid)
