"""Makes the slots of features that observations have in common.

Ranges hold but for the rounding of float32.
"""

import math
from collections.abc import Iterable

from .base import Slot
from .ego_frame import LENGTH_UNIT, SIZE_UNIT, SPEED_UNIT


def place(group: str, prefix: str = "", radius: float = math.inf) -> tuple[Slot, ...]:
    """Describes a place in the frame of the viewer, within a radius [m] of it."""
    far = radius / LENGTH_UNIT
    return _pair(group, (f"{prefix}x", f"{prefix}y"), f"{LENGTH_UNIT:g} m", far)


def heading(group: str) -> tuple[Slot, ...]:
    """Describes the cosine and sine of a yaw relative to the viewer's."""
    return _pair(group, ("cos_yaw", "sin_yaw"), "", 1.0)


def velocity(group: str) -> tuple[Slot, ...]:
    """Describes a velocity along the viewer's axes."""
    return _pair(group, ("velocity_x", "velocity_y"), f"{SPEED_UNIT:g} m/s", math.inf)


def size(group: str) -> tuple[Slot, ...]:
    """Describes the length and width of a box."""
    return tuple(
        Slot(group=group, feature=name, unit=f"{SIZE_UNIT:g} m", low=0.0, high=math.inf)
        for name in ("length", "width")
    )


def kinds(group: str, names: Iterable[str]) -> tuple[Slot, ...]:
    """Describes a one-hot vector: 1 for the kind, and all 0 for other kinds."""
    return tuple(
        Slot(group=group, feature=f"is_{name}", unit="", low=0.0, high=1.0)
        for name in names
    )


def _pair(group, names, unit: str, bound: float) -> tuple[Slot, ...]:
    return tuple(
        Slot(group=group, feature=name, unit=unit, low=-bound, high=bound)
        for name in names
    )
