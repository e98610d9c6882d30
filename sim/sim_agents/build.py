"""Knows the sim agents by name."""

from .. import names
from .base import SimAgent
from .constant_speed import CONSTANT_SPEED
from .idm import IdmConfig, idm
from .playback import PLAYBACK

SIM_AGENTS = {
    "playback": lambda: PLAYBACK,
    "constant_speed": lambda: CONSTANT_SPEED,
    "idm": lambda: idm(IdmConfig()),
    "idm_lights": lambda: idm(IdmConfig(stops_at_lights=True)),
}


def build(name: str) -> SimAgent:
    """Builds a sim agent by name.

    Raises:
        ValueError: if no sim agent has that name.
    """
    if name not in SIM_AGENTS:
        raise names.unknown("sim agent", name, SIM_AGENTS)
    return SIM_AGENTS[name]()
