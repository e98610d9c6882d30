"""Knows the sim agents by name."""

import difflib

from .base import SimAgent
from .constant_speed import CONSTANT_SPEED
from .idm import IdmConfig, idm
from .playback import PLAYBACK

SIM_AGENTS = {
    "playback": lambda: PLAYBACK,
    "constant_speed": lambda: CONSTANT_SPEED,
    "idm": lambda: idm(IdmConfig()),
}


def build(name: str) -> SimAgent:
    """Builds a sim agent by name.

    Raises:
        ValueError: if no sim agent has that name.
    """
    if name not in SIM_AGENTS:
        near = difflib.get_close_matches(name, SIM_AGENTS, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else "."
        raise ValueError(
            f"unknown sim agent '{name}'{hint} Known: {', '.join(SIM_AGENTS)}."
        )
    return SIM_AGENTS[name]()
