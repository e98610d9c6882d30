"""Mixes those whom an agent meets: itself, past selves, rules, and the log."""

import dataclasses

from jaxtyping import Array, Int

from ..agents.base import Agent, Memory, Params
from ..sim.dynamics.base import Action, Dynamics
from ..sim.env import controlled
from ..sim.env.base import Controls
from ..sim.observations.base import Observer, View
from ..sim.sim_agents import build as sim_agents, learned
from ..sim.sim_agents.base import SimAgent
from ..sim.sim_agents.mixture import mixture


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
                f"myself, past and idm must add up to 1 at most, got {parts}."
            )


def team(controls: Controls, config: OpponentsConfig) -> Controls:
    """Returns whom the agent that learns controls."""
    return controlled.share(controls, config.myself)


def others(
    controls: Controls, config: OpponentsConfig, past_self: SimAgent
) -> SimAgent:
    """Builds the sim agent that drives all others.

    Args:
        controls: the whole set; whoever is not in it follows the log.
        config: the parts of the set.
        past_self: drives the part of past selves.
    """
    idm, after = sim_agents.build("idm"), config.myself + config.past
    parts = [
        (past_self, controlled.share(controls, config.past, config.myself)),
        (idm, controlled.share(controls, config.idm, after)),
    ]
    wanted = [config.past > 0, config.idm > 0]
    return mixture([part for part, is_met in zip(parts, wanted, strict=True) if is_met])


def self_of(
    agent: Agent, params: Params, dynamics: Dynamics, observer: Observer
) -> SimAgent:
    """Builds the sim agent by which each object does what an agent finds likeliest.

    Args:
        agent: of one object.
        params: when it was frozen.
        dynamics: of its actions.
        observer: what it sees.
    """

    def act(
        memory: Memory, view: View, number: Int[Array, ""]
    ) -> tuple[Memory, Action]:
        memory, output = agent.step(params, memory, observer.observe(view, number))
        return memory, output.policy.mode()

    return learned.remembering(act, agent.memory(), dynamics, observer.history)
