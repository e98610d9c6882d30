"""Knows the dynamics by name."""

from .. import names
from .base import Dynamics
from .bicycle import bicycle
from .delta import delta
from .discretize import discretize
from .kinematic_bicycle import kinematic_bicycle
from .normalize import normalize
from .pose import pose

DYNAMICS = {
    "delta": lambda: delta("local"),
    "delta_global": lambda: delta("global"),
    "delta_discrete": lambda: discretize(delta("local"), (21, 21, 31)),
    "bicycle": bicycle,
    "bicycle_discrete": lambda: discretize(bicycle(), (13, 25)),
    "bicycle_normalized": lambda: normalize(bicycle()),
    "kinematic_bicycle": kinematic_bicycle,
    "kinematic_bicycle_discrete": lambda: discretize(kinematic_bicycle(), (15, 43)),
    "kinematic_bicycle_head": lambda: discretize(
        kinematic_bicycle(head_tilt=True), (6, 21, 5)
    ),
    "pose": pose,
}


def build(name: str) -> Dynamics:
    """Builds dynamics by name.

    Raises:
        ValueError: if no dynamics have that name.
    """
    if name not in DYNAMICS:
        raise names.unknown("dynamics", name, DYNAMICS)
    return DYNAMICS[name]()
