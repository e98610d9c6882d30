"""Counts who passes a traffic light at red and at green.

About a tenth of WOMD's lights are out of step with the tracks: more pass at red then.
"""

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import LightState, ObjectType
from .packed import LIGHT_VALID, Packed
from .planar_log import PlanarLog

BESIDE = 2.0  # metres from the stop point, across the lane
COSINE = np.cos(np.radians(45.0))  # between the lane and the way that is driven
RED = (LightState.STOP, LightState.ARROW_STOP)
GREEN = (LightState.GO, LightState.ARROW_GO)


def crossings(packed: Packed, log: PlanarLog) -> tuple[int, int]:
    """Returns how many vehicles pass a light at red, and at green.

    A vehicle passes where its centre crosses the line through the stop point, across
    the lane, within 2 m of the point and along the lane (within 45 degrees).

    Args:
        packed: the scenario.
        log: of its objects.
    """
    known = packed.light_has_lane
    place = packed.metres(packed.light_xyz[known, :2])
    yaw = packed.radians(packed.light_yaw[known])
    direction = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    drives = (packed.object_type == ObjectType.VEHICLE) & ~packed.is_still
    passes = _passes(log, drives, place, direction)
    light, step = passes.any(axis=1), packed.light_state[known, 1 : packed.num_steps]
    state = step.astype(np.int64) - LIGHT_VALID
    counts = passes.sum(axis=1)
    red, green = (
        int(counts[light & np.isin(state, states)].sum()) for states in (RED, GREEN)
    )
    return red, green


def _passes(
    log: PlanarLog,
    drives: Bool[np.ndarray, " objects"],
    place: Float[np.ndarray, "lights 2"],
    direction: Float[np.ndarray, "lights 2"],
) -> Bool[np.ndarray, "lights vehicles steps_less_1"]:
    """Tells which vehicle passes which light in which step."""
    offset = log.xy[drives][None] - place[:, None, None]
    along = (offset * direction[:, None, None]).sum(axis=-1)
    side = direction[:, None, None, ::-1] * [-1.0, 1.0]
    across = np.abs((offset * side).sum(axis=-1))
    move = np.diff(log.xy[drives], axis=1)
    ahead = (move[None] * direction[:, None, None]).sum(axis=-1)
    straight = ahead > COSINE * np.maximum(np.linalg.norm(move, axis=-1), 1e-6)
    valid = (log.valid[drives][:, 1:] & log.valid[drives][:, :-1])[None]
    crosses = (along[..., :-1] < 0) & (along[..., 1:] >= 0)
    return crosses & (across[..., 1:] <= BESIDE) & straight & valid
