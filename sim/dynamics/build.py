"""Knows the dynamics by name."""

from .. import names
from .base import Dynamics
from .bicycle import bicycle
from .delta import delta
from .discretize import discretize

DYNAMICS = {
    "delta": lambda: delta("local"),
    "delta_global": lambda: delta("global"),
    "delta_discrete": lambda: discretize(delta("local"), (21, 21, 31)),
    "bicycle": bicycle,
    "bicycle_discrete": lambda: discretize(bicycle(), (13, 25)),
}


def build(name: str) -> Dynamics:
    """Builds dynamics by name.

    Raises:
        ValueError: if no dynamics have that name.
    """
    if name not in DYNAMICS:
        raise names.unknown("dynamics", name, DYNAMICS)
    return DYNAMICS[name]()
