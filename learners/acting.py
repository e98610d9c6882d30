"""Lets an agent drive."""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array, PRNGKeyArray, PyTree

from ..agents.base import Agent
from ..sim.data.bank import Bank
from ..sim.dynamics.base import Action
from ..sim.env.base import Driver, Environment, State


def greedy(agent: Agent, env: Environment) -> Callable[[PyTree, Array], Driver]:
    """Builds the driver that takes the agent's most likely action.

    Returns:
        A function of the agent's parameters and the number of a scenario.
    """

    def driver_of(params: PyTree, number: Array) -> Driver:
        del number

        def act(
            memory: Any, bank: Bank, state: State, key: PRNGKeyArray
        ) -> tuple[Any, Action]:
            del key
            observation = env.observe(bank, state)
            return memory, agent.distribution(params, observation).mode()

        return Driver(lambda scene: (), act)

    return driver_of
