"""Drives by rules: the expert of the log, coasting, chance, and sim agents.

The rules choose an action for each object of a scenario; `ego` and `together` make of
them drivers for planning and for multi-agent.
"""

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from .. import names
from ..data.bank import Bank
from ..dynamics.base import Action, Discrete, Dynamics
from ..metrics.build import EGO
from ..scene import Scene
from ..sim_agents import build as sim_agents
from ..sim_agents.base import Carry, SimAgent
from .base import Act, Driver, State

RULES = {"expert": "playback", "constant_speed": "constant_speed", "idm": "idm"}
NAMES = ("expert", "coast", "random", "constant_speed", "idm")


def guided(dynamics: Dynamics, sim_agent: SimAgent) -> Driver:
    """Builds a driver that goes where a sim agent would put each object.

    The action is the inverse dynamics from the simulated motion to that of the sim
    agent, so errors of the dynamics are corrected as far as the next action can.
    """

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Action]:
        del key
        scene, here = Scene(bank=bank, index=state.index), state.motion
        memory, there = sim_agent.step(scene, memory, here, state.step)
        action = dynamics.inverse(here, there, state.object_size, bank.dt)
        held = dynamics.coast(here, bank.dt)
        is_led = there.valid.reshape(-1, *[1] * (action.ndim - 1))
        return memory, jnp.where(is_led, action, held)

    return Driver(sim_agent.reset, act)


def coast(dynamics: Dynamics) -> Driver:
    """Builds a driver that neither accelerates nor steers."""

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Action]:
        del key
        return memory, dynamics.coast(state.motion, bank.dt)

    return Driver(lambda scene: (), act)


def random(dynamics: Dynamics) -> Driver:
    """Builds a driver that draws each action uniformly from all there are."""
    spec = dynamics.action_spec

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Action]:
        del bank
        num_objects = len(state.admitted)
        if isinstance(spec, Discrete):
            shape = (num_objects,)
            return memory, jax.random.randint(key, shape, 0, spec.num_actions)
        low, high = jnp.array(spec.low)[None], jnp.array(spec.high)[None]
        share = jax.random.uniform(key, (num_objects, low.shape[-1]))
        return memory, low + share * (high - low)

    return Driver(lambda scene: (), act)


def ego(driver: Driver) -> Driver:
    """Builds the driver of the ego alone from one that drives all objects."""

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Action]:
        memory, actions = driver.act(memory, bank, state, key)
        return memory, actions[EGO]

    return Driver(driver.reset, act)


def together(*drivers: Driver) -> Driver:
    """Builds the driver of several teams from one for each, in their order."""

    def reset(scene: Scene) -> Carry:
        return tuple(driver.reset(scene) for driver in drivers)

    def act(
        memory: Carry, bank: Bank, state: State, key: PRNGKeyArray
    ) -> tuple[Carry, Act]:
        keys = jax.random.split(key, len(drivers))
        acts = [
            driver.act(own, bank, state, own_key)
            for driver, own, own_key in zip(drivers, memory, keys, strict=True)
        ]
        return tuple(own for own, _ in acts), tuple(action for _, action in acts)

    return Driver(reset, act)


def build(name: str, dynamics: Dynamics) -> Driver:
    """Builds a driver of the ego by name.

    Raises:
        ValueError: if no driver has that name.
    """
    return ego(build_all(name, dynamics))


def build_all(name: str, dynamics: Dynamics) -> Driver:
    """Builds a driver of all objects by name.

    Raises:
        ValueError: if no driver has that name.
    """
    if name in RULES:
        return guided(dynamics, sim_agents.build(RULES[name]))
    if name == "coast":
        return coast(dynamics)
    if name == "random":
        return random(dynamics)
    raise names.unknown("agent", name, NAMES)
