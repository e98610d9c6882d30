"""Tests that costs can be differentiated through a whole episode."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import rewards
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import drivers
from drivetrain.sim.env.planning import planning
from drivetrain.sim.metrics.displacement import DISPLACEMENT
from drivetrain.sim.metrics.route import PROGRESS
from drivetrain.sim.metrics.smooth import SMOOTH_COLLISION, SMOOTH_OFFROAD
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.sim_agents import build as sim_agents
from tests import worlds

NAMES = ("bicycle", "delta")
METRICS = (DISPLACEMENT, PROGRESS, SMOOTH_COLLISION, SMOOTH_OFFROAD)
BLIND = VectorConfig(history=0, num_objects=1, num_road=1, num_lights=1, num_route=0)
STEPS = 80

# Displacement has a kink on the log, so the expert's actions are changed by these at
# each step. In these calm scenes the car then comes near others and the road edge, and
# a stride meets no kink of distances to boxes and polylines.
CALM = synthetic.SyntheticConfig(kinds=("road",), max_others=3)
SEEDS = {"bicycle": 31, "delta": 71}
KICKS = {"bicycle": (-0.2, -0.004), "delta": (-0.08, -0.01, -0.001)}

# How much of each control, held or only in the first step, moves the end of the episode
# by 1 to 5 cm: a thousand roundings of float32, and a tenth of the costs' softness.
STRIDES = {"bicycle": (1e-3, 3e-5), "delta": (3e-4, 3e-4, 3e-5)}
FIRST_STRIDE = 30.0  # of a held one

# A thousand roundings leave 0.1 %; curvature over a stride adds as much. Progress and
# the distance to the road edge are those to polylines: their slope jumps where the
# nearest piece changes, and a difference there sees the mean of both sides.
TOLERANCES = {
    "log_displacement": 5e-3,
    "smooth_collision": 5e-3,
    "progress": 0.1,
    "smooth_offroad": 0.1,
}


class Episode(NamedTuple):
    """An episode as functions of the bank and a scenario's number."""

    expert: Callable  # (bank, index): its actions [steps, features]
    costs: Callable  # (actions, bank, index): the mean over steps of each metric
    slopes: Callable  # (actions, bank, index): of the costs by each action


@functools.cache
def episode(name: str) -> Episode:
    """Builds the episode of some dynamics."""
    move = dynamics.build(name)
    reward = rewards.weighted({"log_displacement": -1.0})
    env = planning(
        move, sim_agents.build("playback"), vector(BLIND), reward, metrics=METRICS
    )
    driver = drivers.build("expert", move)

    def play(choose, bank: Bank, index, actions):
        def step(state, action):
            action = choose(bank, state, action)
            following, timestep = env.step(bank, state, action)
            values = [timestep.measures[metric.name].value for metric in METRICS]
            return following, (action, jnp.stack(values))

        state = env.reset(bank, index, jax.random.key(0))
        return jax.lax.scan(step, state, actions)[1]

    def imitate(bank, state, action):
        del action
        return driver.act((), bank, state, jax.random.key(0))[1]

    def costs(actions, bank, index):
        _, values = play(lambda bank, state, action: action, bank, index, actions)
        return values.mean(axis=0)

    return Episode(
        expert=jax.jit(
            lambda bank, index: play(imitate, bank, index, jnp.arange(STEPS))[0]
        ),
        costs=jax.jit(costs),
        slopes=jax.jit(jax.jacrev(costs)),
    )


@functools.cache
def compared(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the costs, and their slopes along directions: by gradient, by strides."""
    scene = pack(synthetic.generate(SEEDS[name], CALM), PackConfig())
    bank, index, played = worlds.bank_of([scene]), jnp.int32(0), episode(name)
    expert = played.expert(bank, index)
    actions = expert + jnp.broadcast_to(jnp.array(KICKS[name]), expert.shape)
    slopes = np.asarray(played.slopes(actions, bank, index))
    by_gradient, by_stride = [], []
    for feature, held in enumerate(STRIDES[name]):
        for steps, stride in ((STEPS, held), (1, FIRST_STRIDE * held)):
            shift = jnp.zeros_like(actions).at[:steps, feature].set(stride)
            beyond, short = (
                played.costs(actions + sign * shift, bank, index) for sign in (1, -1)
            )
            by_gradient.append(slopes[:, :steps, feature].sum(axis=-1))
            by_stride.append(np.asarray(beyond - short) / (2 * stride))
    cost = np.asarray(played.costs(actions, bank, index))
    return cost, np.array(by_gradient), np.array(by_stride)


@pytest.mark.parametrize("metric", range(len(METRICS)), ids=lambda i: METRICS[i].name)
@pytest.mark.parametrize("name", NAMES)
def test_gradients_are_those_of_differences(name: str, metric: int) -> None:
    cost, by_gradient, by_stride = (x[..., metric] for x in compared(name))
    assert cost > 0.01  # else the episode proves nothing
    tolerance = TOLERANCES[METRICS[metric].name]
    np.testing.assert_allclose(by_gradient, by_stride, rtol=tolerance, atol=0)


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("name", NAMES)
def test_gradients_are_finite_on_the_log(name: str, kind: str) -> None:
    bank, played = worlds.bank(kind), episode(name)
    for index in map(jnp.int32, range(len(worlds.scenarios(kind)))):
        slopes = played.slopes(played.expert(bank, index), bank, index)
        assert np.isfinite(slopes).all()
        assert np.abs(slopes[1:]).max() > 0
