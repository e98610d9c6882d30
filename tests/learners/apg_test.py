"""Tests that analytic policy gradients follow the slope of rewards through dynamics."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Agent, Memory, Output
from drivetrain.agents.distributions import TanhMixture
from drivetrain.learners import mesh as meshes, optim, program
from drivetrain.learners.apg import AnalyticConfig, analytic_policy_gradient
from drivetrain.learners.base import Learner, Metrics, TrainState
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.dynamics.base import Continuous
from drivetrain.sim.env.base import Environment, State, Timestep
from drivetrain.sim.observations.base import Observation, TokenGroup
from tests.learners import probes

BOUNDS = Continuous(low=(-1.0,), high=(1.0,))
LAST = 4  # steps of an episode
# The first action decides where all later steps stand: x = a_0 after the first.
GOAL = 0.5
CONFIG = AnalyticConfig(
    num_worlds=16, steps_per_update=LAST + 1, learning_rate=3e-2, strata=8
)


def environment(spread: float = 0.0) -> Environment:
    """Makes a world in which only the first action moves, and the last step pays.

    Args:
        spread: how far from 0 episodes may begin, by their scenario and key.
    """

    def reset(bank: Bank, index: jax.Array, key: jax.Array) -> State:
        coin_key = probes.coin_key(bank, index, key)
        empty = {field.name: () for field in dataclasses.fields(State)}
        here = {
            "index": index,
            "step": jnp.int32(0),
            "sim_agent": jax.random.uniform(
                coin_key, (), minval=-spread, maxval=spread
            ),
            "admitted": jnp.ones(1, bool),
            "key": key,
        }
        return State(**empty | here)

    def step(bank: Bank, state: State, action: jax.Array) -> tuple[State, Timestep]:
        start = state.sim_agent  # where it stands
        place = jnp.where(state.step == 0, start + action[0], start)
        late = state.step + 1 == LAST
        timestep = Timestep(
            acted=jnp.bool_(True),
            reward=-jnp.where(late, (place - GOAL) ** 2, 0.0),
            discount=jnp.float32(1.0),
            terminated=jnp.bool_(False),
            truncated=late,
            measures={},
        )
        return state.replace(step=state.step + 1, sim_agent=place), timestep

    def observe(bank: Bank, state: State) -> Observation:
        seen = jnp.ones((1, 1, 1))
        return {"one": TokenGroup(values=seen, mask=jnp.ones((1, 1), bool))}

    return Environment(BOUNDS, reset, step, observe)


def agent(spread: float = 0.0) -> Agent:
    """Builds an agent of one number, the mean of its action before squashing.

    Args:
        spread: how much of it depends on the key.
    """

    def step(
        params: dict[str, jax.Array], memory: Memory, observation: Observation
    ) -> tuple[Memory, Output]:
        policy = TanhMixture(
            logits=jnp.zeros(1),
            mean=params["mean"].reshape(1, 1),
            scale=jnp.ones((1, 1)),
            bounds=BOUNDS,
        )
        return memory, Output(policy=policy, value=jnp.zeros(()))

    def init(key: jax.Array) -> dict[str, jax.Array]:
        return {"mean": jnp.float32(-0.3) + spread * jax.random.normal(key)}

    return Agent(init=init, memory=lambda: (), step=step)


def learner(config: AnalyticConfig = CONFIG, spread: float = 0.0) -> Learner:
    optimizer, env = optim.adam(config), environment(spread)
    return analytic_policy_gradient(env, agent(spread), optimizer, config)


def trained(config: AnalyticConfig, num_updates: int) -> tuple[TrainState, Metrics]:
    made = learner(config)
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, probes.bank(mesh.size))
    run = program.compile_program(made, mesh, num_updates)
    return run(program.initial_state(made, mesh, jax.random.key(0), bank), bank)


def test_an_action_is_moved_by_what_it_leads_to_steps_later() -> None:
    state, metrics = trained(CONFIG, 100)
    np.testing.assert_allclose(np.tanh(state.params["mean"]), GOAL, atol=1e-2)
    assert metrics["loss"].total[-1] < 1e-3


def test_the_first_gradient_is_that_of_the_chain_rule() -> None:
    _, metrics = trained(CONFIG, 1)
    # One of the four steps that act pays; the fifth shows how the episode ended.
    place, slope = np.tanh(-0.3), 1 - np.tanh(-0.3) ** 2
    expected = 2 * (place - GOAL) * slope / LAST
    loss = metrics["loss"].total[0] / metrics["loss"].weight[0]
    np.testing.assert_allclose(loss, (place - GOAL) ** 2 / LAST, rtol=1e-5)  # float32
    np.testing.assert_allclose(
        metrics["gradient_norm"].total[0], abs(expected), rtol=1e-5
    )


def test_windows_that_end_before_the_reward_say_nothing() -> None:
    state, _ = trained(dataclasses.replace(CONFIG, steps_per_update=LAST - 1), 1)
    assert state.params["mean"] == np.float32(-0.3)


def test_numbered_actions_are_refused() -> None:
    env = probes.environment(probes.VALUE)
    with pytest.raises(ValueError, match="apg needs continuous actions"):
        analytic_policy_gradient(env, agent(), optim.adam(CONFIG), CONFIG)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"num_worlds": 12}, "num_worlds must be a positive multiple of strata"),
        ({"steps_per_update": 0}, "steps_per_update must be at least 1, got 0"),
    ],
)
def test_values_out_of_range_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AnalyticConfig(**fields)
