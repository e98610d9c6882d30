"""Drives the ego by rules: the expert of the log, coasting, and sim agents."""

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from .. import names
from ..data.bank import Bank
from ..dynamics.base import Action, Dynamics
from ..metrics.build import EGO
from ..scene import Scene
from ..sim_agents import build as sim_agents
from ..sim_agents.base import Carry, SimAgent
from .base import Driver, State
from .planning import object_of

RULES = {"expert": "playback", "constant_speed": "constant_speed", "idm": "idm"}
NAMES = ("expert", "coast", "constant_speed", "idm")


def guided(dynamics: Dynamics, sim_agent: SimAgent) -> Driver:
    """Builds a driver that goes where a sim agent would put the ego.

    The action is the inverse dynamics from the simulated motion to that of the sim
    agent, so errors of the dynamics are corrected as far as the next action can.
    """

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Action]:
        del key
        scene = Scene(bank=bank, index=state.index)
        memory, goal = sim_agent.step(scene, memory, state.motion, state.step)
        here, there = (object_of(motion, EGO) for motion in (state.motion, goal))
        action = dynamics.inverse(here, there, state.object_size[EGO], bank.dt)
        held = dynamics.coast(here, bank.dt)
        return memory, jnp.where(there.valid, action, held)

    return Driver(sim_agent.reset, act)


def coast(dynamics: Dynamics) -> Driver:
    """Builds a driver that neither accelerates nor steers."""

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Action]:
        del key
        return memory, dynamics.coast(object_of(state.motion, EGO), bank.dt)

    return Driver(lambda scene: (), act)


def build(name: str, dynamics: Dynamics) -> Driver:
    """Builds a driver by name.

    Raises:
        ValueError: if no driver has that name.
    """
    if name == "coast":
        return coast(dynamics)
    if name in RULES:
        return guided(dynamics, sim_agents.build(RULES[name]))
    raise names.unknown("agent", name, NAMES)
