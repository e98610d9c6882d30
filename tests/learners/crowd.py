"""A toy task of several actors: each has a coin of its own, and some leave early."""

import dataclasses

import jax
import jax.numpy as jnp

from drivetrain.sim.data.bank import Bank
from drivetrain.sim.dynamics.base import Discrete
from drivetrain.sim.env import controlled
from drivetrain.sim.env.base import Environment, State, Timestep
from drivetrain.sim.metrics.base import Measure
from drivetrain.sim.observations.base import Observation, TokenGroup
from tests.learners import probes

NUM_ACTORS, NUM_STEPS = 5, 3
# How many steps each stays: one is never there, two leave early, two see the log end.
STAYS = (1, 0, 2, 9, 9)


def environment(garbage: float = 0.0, max_actors: int | None = None) -> Environment:
    """Makes the environment, in which the better action is that of the own coin.

    Args:
        garbage: what stands where nobody is.
        max_actors: how many seats there are for those who ever act; None: one for each.
    """
    stays = jnp.array(STAYS)

    def reset(bank: Bank, index: jax.Array, key: jax.Array) -> State:
        empty = {field.name: () for field in dataclasses.fields(State)}
        here = {
            "index": index,
            "step": jnp.int32(0),
            "sim_agent": jax.random.rademacher(
                probes.coin_key(bank, index, key), (NUM_ACTORS,), jnp.float32
            ),
            "admitted": jnp.ones(NUM_ACTORS, bool),
            "teams": (stays > 0,),
        }
        return State(**empty | here)  # type: ignore[arg-type]

    def step(
        bank: Bank, state: State, actions: tuple[jax.Array]
    ) -> tuple[State, Timestep]:
        acted, goes_on = state.step < stays, state.step + 1 < stays
        right = (actions[0] == (state.sim_agent > 0)).astype(jnp.float32)
        timestep = Timestep(
            acted=acted,
            reward=jnp.where(acted, right, garbage),
            discount=jnp.where(acted, goes_on.astype(jnp.float32), garbage),
            terminated=~goes_on,
            truncated=state.step + 1 >= NUM_STEPS,
            measures={"collision": Measure(value=1 - right, valid=acted)},
        )
        return state.replace(step=state.step + 1), timestep

    def observe(bank: Bank, state: State) -> Observation:
        told = jax.nn.one_hot(state.step, probes.MAX_STEPS)
        told = jnp.broadcast_to(told[None], (NUM_ACTORS, probes.MAX_STEPS))
        values = jnp.concatenate([told, state.sim_agent[:, None]], axis=-1)
        there = (state.step < stays)[:, None]
        values = jnp.where(there, values, garbage)[:, None, None]
        mask = jnp.ones((NUM_ACTORS, 1, 1), bool)
        seats = controlled.actors(max_actors, state)
        seen = TokenGroup(values=values, mask=mask)
        return {"coin": jax.tree.map(lambda leaf: leaf[seats], seen)}

    return Environment((Discrete(2),), reset, step, observe, max_actors)
