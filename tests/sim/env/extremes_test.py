"""Tests that no state which a policy can reach makes a number that is not finite."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import rewards
from drivetrain.sim.data import bank as banks
from drivetrain.sim.data.bank import Bank, Sizes
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.dynamics.base import Discrete, Dynamics
from drivetrain.sim.env import controlled
from drivetrain.sim.env.base import Team
from drivetrain.sim.env.multi_agent import multi_agent
from drivetrain.sim.observations import compact, nocturne, vector
from drivetrain.sim.scenario import MapType, Polylines, Scenario
from drivetrain.sim.sim_agents import build as sim_agents
from tests import worlds

NUM_STEPS = 1_000_000  # of objects that act
NUM_WORLDS = 100
NUM_OBJECTS = 16
OBSERVERS = {
    "compact": compact.compact(compact.CompactConfig(num_objects=4, num_road=8)),
    "vector": vector.vector(vector.VectorConfig(history=1, num_objects=4, num_road=8)),
    "nocturne": nocturne.nocturne(nocturne.NocturneConfig(num_objects=4, num_road=8)),
}


def without_road(scenario: Scenario) -> Scenario:
    """Leaves one sign of the map."""
    roads = Polylines(
        xyz=scenario.origin[None],
        offset=np.array([0, 1]),
        map_type=np.array([MapType.STOP_SIGN]),
        feature_id=np.array([0]),
    )
    return dataclasses.replace(scenario, roads=roads)


def standing(scenario: Scenario) -> Scenario:
    """Lets everybody stand where the ego is: all boxes coincide."""
    tracks, ego = scenario.tracks, scenario.ego_index
    there = dataclasses.replace(
        tracks,
        xyz=np.broadcast_to(scenario.origin, tracks.xyz.shape).copy(),
        yaw=np.full_like(tracks.yaw, tracks.yaw[ego, scenario.current_step]),
        velocity=np.zeros_like(tracks.velocity),
    )
    return dataclasses.replace(scenario, tracks=there)


def alone(scenario: Scenario) -> Scenario:
    """Leaves the ego alone."""
    ego = np.arange(len(scenario.tracks.object_id)) == scenario.ego_index
    valid = scenario.tracks.valid & ego[:, None]
    tracks = dataclasses.replace(scenario.tracks, valid=valid)
    return dataclasses.replace(scenario, tracks=tracks)


def without_size(scenario: Scenario) -> Scenario:
    """Makes everybody a point."""
    size = np.zeros_like(scenario.tracks.size)
    tracks = dataclasses.replace(scenario.tracks, size=size)
    return dataclasses.replace(scenario, tracks=tracks)


@functools.cache
def extreme_bank() -> Bank:
    scenarios = worlds.scenarios("generated")
    made = [*scenarios[:4]]
    made += [change(scenarios[0]) for change in (without_road, standing, alone)]
    made += [without_size(standing(scenarios[1])), without_road(alone(scenarios[2]))]
    packed = [pack(scenario, PackConfig()) for scenario in made]
    return jax.device_put(banks.build(packed, Sizes.of(packed, NUM_OBJECTS)))


def wild_actions(key, rules: Dynamics, num_objects: int):
    """Draws the bounds, what lies far beyond them, and nothing at all."""
    spec = rules.action_spec
    if isinstance(spec, Discrete):
        return jax.random.randint(key, (num_objects,), 0, spec.num_actions)
    low, high = (jnp.clip(jnp.array(x), -1e3, 1e3) for x in (spec.low, spec.high))
    shape = (num_objects, len(spec.low))
    pick = jax.random.randint(key, shape, 0, 5)
    choices = [low, high, 100 * low, 100 * high, jnp.zeros_like(low)]
    return jnp.choose(
        pick, [jnp.broadcast_to(c[None], shape) for c in choices], mode="clip"
    )


@pytest.mark.parametrize(
    ("name", "observer", "sim_agent"),
    [
        ("bicycle", "vector", "idm"),
        ("delta", "compact", "constant_speed"),
        ("kinematic_bicycle", "nocturne", "playback"),
        ("bicycle_discrete", "compact", "idm"),
    ],
)
def test_a_million_extreme_steps_stay_finite(name, observer, sim_agent) -> None:
    rules, bank = dynamics.build(name), extreme_bank()
    num_objects = bank.sizes.num_objects
    env = multi_agent(
        (Team(rules, controlled.everyone),),
        sim_agents.build(sim_agent),
        OBSERVERS[observer],
        rewards.weighted(rewards.SPARSE),
    )

    def num_bad(tree):
        leaves = [x for x in jax.tree.leaves(tree) if x.dtype == jnp.float32]
        return sum(jnp.sum(~jnp.isfinite(leaf)) for leaf in leaves)

    def play(index, key):
        def step(state, key):
            actions = wild_actions(key, rules, num_objects)
            state, timestep = env.step(bank, state, (actions,))
            seen = env.observe(bank, state)
            out = (timestep.reward, timestep.measures, state.motion, seen)
            return state, (num_bad(out), jnp.sum(timestep.acted))

        keys = jax.random.split(key, 80)
        return jax.lax.scan(step, env.reset(bank, index, key), keys)[1]

    play_all = jax.jit(jax.vmap(play))
    num_steps, key = 0, jax.random.key(0)
    indices = jnp.arange(NUM_WORLDS) % bank.num_scenarios
    while num_steps < NUM_STEPS:
        key, call_key = jax.random.split(key)
        bad, acted = play_all(indices, jax.random.split(call_key, NUM_WORLDS))
        assert int(bad.sum()) == 0
        assert int(acted.sum()) > 0
        num_steps += int(acted.sum())
