"""Reads the logged motion of a packed scenario back on the host."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from . import log_rows
from .packed import Packed


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PlanarLog:
    """The log of all objects, places in the plane apart from heights.

    The frame is the scenario's.

    Where not valid, values are zero.
    """

    xy: Float[np.ndarray, "objects steps 2"]  # metres
    height: Float[np.ndarray, "objects steps"]  # metres
    yaw: Float[np.ndarray, "objects steps"]  # radians
    velocity: Float[np.ndarray, "objects steps 2"]  # metres per second
    valid: Bool[np.ndarray, "objects steps"]


def planar_log(packed: Packed) -> PlanarLog:
    """Decodes the log of a packed scenario."""
    valid = log_rows.valid_mask(packed.valid_bits, packed.num_steps)
    counts = valid.sum(axis=1)
    kept = log_rows.kept_rows(packed.is_still, counts)
    row = np.cumsum(kept) - 1  # of each valid step; still objects have one
    xyz, yaw, velocity = (np.zeros((*valid.shape, *tail)) for tail in ((3,), (), (2,)))
    xyz[valid] = packed.metres(packed.poses[row])
    yaw[valid] = packed.radians(packed.turns[row, 0])
    velocity[valid] = packed.speeds(packed.turns[row, 1:])
    return PlanarLog(
        xy=xyz[..., :2], height=xyz[..., 2], yaw=yaw, velocity=velocity, valid=valid
    )
