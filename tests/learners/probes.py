"""Worlds so small that a learner of one ability solves them, and others cannot.

In each a coin is thrown at the start: `sign` is 1 or -1. Observations are a one-hot of
the step and the sign, where it is shown.
"""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp

from drivetrain.agents.base import Agent, Memory, Output
from drivetrain.sim.data import dealing
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.dynamics.base import Discrete
from drivetrain.sim.env.base import Environment, State, Timestep
from drivetrain.sim.metrics.base import Measure
from drivetrain.sim.observations.base import Observation, TokenGroup

NUM_SCENARIOS = 32
NUM_STRATA = 8  # as learners have if nobody says otherwise
NUM_ACTIONS = 2
MAX_STEPS = 3
NUM_FEATURES = MAX_STEPS + 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Probe:
    """A world of a coin, with one actor.

    `reward(step, sign, action)` is that of an action at a step from 0 to
    `num_steps - 1`. `shows(step)` says when the sign is seen.
    """

    num_steps: int
    reward: Callable[[jax.Array, jax.Array, jax.Array], jax.Array]
    shows: Callable[[jax.Array], jax.Array | bool] = lambda step: False
    tells_step: bool = True  # whether the step is seen
    truncates: bool = False  # the episode is cut, while the task would go on


def _matches(sign: jax.Array, action: jax.Array) -> jax.Array:
    """Returns 1 where the action is 1 for heads and 0 for tails, else 0."""
    return (action == (sign > 0)).astype(jnp.float32)


# Each needs what the one before does, and the ability of its name.
VALUE = Probe(num_steps=1, reward=lambda step, sign, action: jnp.float32(1.0))
# The reward of a single step late is worth less before.
DISCOUNTING = Probe(
    num_steps=2, reward=lambda step, sign, action: (step == 1).astype(jnp.float32)
)
# The sign tells the reward a step ahead.
BOOTSTRAPPING = Probe(
    num_steps=2,
    reward=lambda step, sign, action: jnp.where(step == 1, sign, 0.0),
    shows=lambda step: True,
)
# A reward of 1 at each step, cut after two: worth 1 / (1 - gamma) all the same.
TRUNCATION = Probe(
    num_steps=2,
    reward=lambda step, sign, action: jnp.float32(1.0),
    tells_step=False,
    truncates=True,
)
# Action 1 is worth 1, action 0 nothing.
POLICY = Probe(
    num_steps=1, reward=lambda step, sign, action: action.astype(jnp.float32)
)
# The better action is that of the sign.
MATCHING = Probe(
    num_steps=1,
    reward=lambda step, sign, action: _matches(sign, action),
    shows=lambda step: True,
)
# The sign is shown at the first step only, and decides about the action at the last.
MEMORY = Probe(
    num_steps=3,
    reward=lambda step, sign, action: jnp.where(step == 2, _matches(sign, action), 0.0),
    shows=lambda step: step == 0,
)


def bank(num_devices: int) -> Bank:
    """Returns a bank of empty scenarios, dealt out to the devices, its leading axis.

    Where the number of steps would be it has the number of a scenario among all.
    """
    dealt = dealing.by_stratum(NUM_SCENARIOS, num_devices, NUM_STRATA)
    empty = {field.name: () for field in dataclasses.fields(Bank)}
    here = {
        "num_scenarios": jnp.full(num_devices, len(dealt[0]), jnp.int32),
        "num_steps": jnp.array(dealt, jnp.int32),
    }
    return Bank(**empty | here)


def coin_key(bank: Bank, index: jax.Array, key: jax.Array) -> jax.Array:
    """Returns the key of a coin, another one for each scenario."""
    return jax.random.fold_in(key, bank.num_steps[index])


def state(step: int, sign: float) -> State:
    """Returns the world at a step; the coin lies where a sim agent's memory would."""
    return _state(jnp.int32(step), jnp.float32(sign), jax.random.key(0))


def _state(step: jax.Array, sign: jax.Array, key: jax.Array) -> State:
    empty = {field.name: () for field in dataclasses.fields(State)}
    here = {
        "index": jnp.int32(0),
        "step": step,
        "sim_agent": sign,
        "admitted": jnp.ones(1, bool),
        "key": key,
    }
    return State(**empty | here)


def environment(probe: Probe) -> Environment:
    """Makes the environment; its measures tell `collision` where a reward is 0."""

    def reset(bank: Bank, index: jax.Array, key: jax.Array) -> State:
        key, sign_key = jax.random.split(key)
        sign_key = coin_key(bank, index, sign_key)
        sign = jax.random.rademacher(sign_key, (), jnp.float32)
        return _state(jnp.int32(0), sign, key).replace(index=index)

    def step(bank: Bank, state: State, action: jax.Array) -> tuple[State, Timestep]:
        reward = probe.reward(state.step, state.sim_agent, action)
        is_last = state.step + 1 >= probe.num_steps
        terminated = is_last & (not probe.truncates)
        failed = (reward == 0).astype(jnp.float32)
        timestep = Timestep(
            acted=jnp.bool_(True),
            reward=reward,
            discount=1.0 - terminated.astype(jnp.float32),
            terminated=terminated,
            truncated=is_last & probe.truncates,
            measures={"collision": Measure(value=failed, valid=jnp.bool_(True))},
        )
        return state.replace(step=state.step + 1), timestep

    def observe(bank: Bank, state: State) -> Observation:
        # Of the step after the longest episode there is no feature: all are zero.
        told = jax.nn.one_hot(state.step * probe.tells_step, MAX_STEPS)
        sign = jnp.where(probe.shows(state.step), state.sim_agent, 0.0)
        values = jnp.append(told, sign)[None, None]
        return {"coin": TokenGroup(values=values, mask=jnp.ones((1, 1), bool))}

    return Environment(Discrete(NUM_ACTIONS), reset, step, observe)


def observe(probe: Probe, step: int, sign: float) -> Observation:
    """Returns what is seen at a step."""
    one = jax.tree.map(lambda leaf: leaf[0], bank(1))
    return environment(probe).observe(one, state(step, sign))


def linear_agent(output: Callable[[jax.Array], Output], num_outputs: int) -> Agent:
    """Builds an agent without memory, linear in a one-hot of step and sign together.

    Args:
        output: makes an agent's output of `num_outputs` numbers.
        num_outputs: how many.
    """

    def init(key: jax.Array) -> dict[str, jax.Array]:
        return {"table": 0.1 * jax.random.normal(key, (3 * MAX_STEPS, num_outputs))}

    def step(
        params: dict[str, jax.Array], memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        seen = observation["coin"].values.reshape(NUM_FEATURES)
        side = seen[-1] == jnp.array([-1.0, 0.0, 1.0])
        row = jnp.outer(seen[:-1], side).reshape(-1)
        return memory, output(row @ params["table"])

    return Agent(init=init, memory=lambda: (), step=step)
