"""Mixes those whom an agent meets: itself, past selves, rules, and the log."""

import dataclasses

from jaxtyping import Array, Int

from ..agents.base import Agent, Memory
from ..sim.dynamics.base import Action, Dynamics
from ..sim.env import controlled
from ..sim.env.base import Controls
from ..sim.env.starts import lot_key
from ..sim.motion import Motion
from ..sim.observations.base import Observer, View
from ..sim.scene import Scene
from ..sim.sim_agents import build as sim_agents, learned
from ..sim.sim_agents.base import Carry, SimAgent
from ..sim.sim_agents.mixture import mixture
from . import pasts as ring
from .pasts import Pasts

PAST_LOT = 2  # the number of drawing a past self; 1 is of `controlled.LOTS`


@dataclasses.dataclass(frozen=True, kw_only=True)
class OpponentsConfig:
    """Who drives which part of a set of objects; the log drives the rest of them.

    Parts are drawn anew for each episode, rounded up in this order.
    """

    myself: float = 1.0  # the agent that learns
    past: float = 0.0  # one of its past selves
    idm: float = 0.0  # the intelligent driver model

    def __post_init__(self) -> None:
        """Checks the parts.

        Raises:
            ValueError: if one is negative, nobody learns, or they exceed a whole.
        """
        parts = self.myself, self.past, self.idm
        if not (self.myself > 0 and min(parts) >= 0):
            raise ValueError(
                f"myself must be positive, past and idm at least 0, got {parts}."
            )
        if sum(parts) > 1 + controlled.ROUNDING:
            raise ValueError(
                f"myself, past and idm must add up to 1 at most, the rest being the "
                f"log's, got {self.myself} + {self.past} + {self.idm}; set all three."
            )


def team(controls: Controls, config: OpponentsConfig) -> Controls:
    """Returns whom the agent that learns controls."""
    return controlled.share(controls, config.myself)


def others(
    controls: Controls, config: OpponentsConfig, past: SimAgent | None
) -> SimAgent:
    """Builds the sim agent that drives all others.

    Args:
        controls: the whole set; whoever is not in it follows the log.
        config: the parts of the set.
        past: drives the part of past selves; None where that is empty.
    """
    parts = []
    if past is not None:
        mask = controlled.share(controls, config.past, config.myself)
        parts.append((past, mask))
    if config.idm:
        mask = controlled.share(controls, config.idm, config.myself + config.past)
        parts.append((sim_agents.build("idm"), mask))
    return mixture(parts)


def past_self(
    agent: Agent, pasts: Pasts, dynamics: Dynamics, observer: Observer
) -> SimAgent:
    """Builds the sim agent that is one past self in each episode, drawn as it begins.

    Each object does what the past self finds likeliest. One that is replaced in the
    ring meanwhile goes on as its successor.

    Args:
        agent: of one object.
        pasts: the parameters of its past selves.
        dynamics: of its actions.
        observer: what it sees.
    """

    def at(place: Int[Array, ""]) -> SimAgent:
        params = ring.at(pasts, place)

        def act(
            memory: Memory, view: View, number: Int[Array, ""]
        ) -> tuple[Memory, Action]:
            memory, output = agent.step(params, memory, observer.observe(view, number))
            return memory, output.policy.mode()

        return learned.remembering(act, agent.memory(), dynamics, observer.history)

    def reset(scene: Scene) -> Carry:
        place = ring.draw(pasts, lot_key(scene, PAST_LOT))
        return place, at(place).reset(scene)

    def step(
        scene: Scene, carry: Carry, motion: Motion, step: Int[Array, ""]
    ) -> tuple[Carry, Motion]:
        place, memory = carry
        memory, moved = at(place).step(scene, memory, motion, step)
        return (place, memory), moved

    return SimAgent("past self", reset, step)
