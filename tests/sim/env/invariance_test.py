"""Tests what must make no difference to a world: order, padding, batches, the task."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim import rewards
from drivetrain.sim.data import bank as banks
from drivetrain.sim.data.bank import Sizes
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import controlled, drivers
from drivetrain.sim.env.base import Environment, Team
from drivetrain.sim.env.multi_agent import multi_agent
from drivetrain.sim.env.planning import planning
from drivetrain.sim.env.rollout import rollout
from drivetrain.sim.observations.vector import vector
from drivetrain.sim.scenario import ObjectType
from drivetrain.sim.sim_agents.base import SimAgent
from drivetrain.sim.sim_agents.playback import PLAYBACK
from tests import worlds
from tests.sim.env.multi_agent_test import (
    BUSY,
    CHEAP,
    DRIFT,
    IDM,
    SMALL,
    Step,
    assert_equal,
    env_of,
    played,
    wild,
)


def permuted(packed: Packed, order: np.ndarray) -> Packed:
    """Returns the scenario with its objects in another order."""
    counts = np.bitwise_count(packed.valid_bits).sum(axis=1, dtype=int)
    counts = np.where(packed.is_still, 1, counts)
    ends = np.cumsum(counts)
    rows = np.concatenate([np.arange(ends[i] - counts[i], ends[i]) for i in order])
    tables = ("object_id", "object_type", "object_size", "goal_feasible", "valid_bits")
    tables += ("is_still",)
    return dataclasses.replace(
        packed,
        poses=packed.poses[rows],
        turns=packed.turns[rows],
        **{name: getattr(packed, name)[order] for name in tables},
    )


def crowd(sim_agent: SimAgent = IDM) -> Environment:
    team = Team(dynamics.build("bicycle"), controlled.of_type(ObjectType.CYCLIST))
    cars = Team(dynamics.build("bicycle"), controlled.moving_vehicles())
    return env_of((team, cars), sim_agent, remove_at=("collision",))


def per_object(step: Step) -> tuple[Any, ...]:
    state, timestep = step.state, step.timestep
    return state.motion, state.controls, timestep.replace(truncated=state.admitted)


def test_permuting_objects_permutes_results() -> None:
    packed = worlds.exact(worlds.scenarios("generated")[BUSY])
    count = len(packed.object_id)
    order = np.append(0, 1 + np.random.default_rng(1).permutation(count - 1))
    actions = wild(count)
    straight = played(crowd(), worlds.bank_of([packed]), 0, (actions,) * 2)
    other = worlds.bank_of([permuted(packed, order)])
    shuffled = played(crowd(), other, 0, (actions[:, order],) * 2)
    assert straight.timestep.terminated.any(axis=1).sum() > 1
    expected = jax.tree.map(lambda leaf: leaf[:, order], per_object(straight))
    assert_equal(per_object(shuffled), expected, DRIFT)


def test_padding_changes_nothing() -> None:
    packed = [worlds.exact(worlds.scenarios("generated")[BUSY])]
    count = len(packed[0].object_id)
    sizes = Sizes.of(packed, count)
    larger = {f.name: getattr(sizes, f.name) + 3 for f in dataclasses.fields(sizes)}
    padded = jax.device_put(banks.build(packed, Sizes(**larger)))
    actions = wild(count + 3)
    wide = played(crowd(), padded, 0, (actions,) * 2)
    narrow = played(crowd(), worlds.bank_of(packed), 0, (actions[:, :count],) * 2)
    cut = jax.tree.map(lambda leaf: leaf[:, :count], per_object(wide))
    assert_equal(cut, per_object(narrow), DRIFT)
    assert not wide.state.motion.valid[:, count:].any()


def test_a_batch_equals_a_loop() -> None:
    env, bank = crowd(PLAYBACK), worlds.bank("generated")
    driver = drivers.together(*[drivers.random(dynamics.build("bicycle"))] * 2)

    def play(index):
        out = rollout(env, driver, bank, index, jax.random.key(0))
        return out.motion, out.reward, out.measures

    together = jax.jit(jax.vmap(play))(jnp.array([0, BUSY]))
    for place, index in enumerate((0, BUSY)):
        alone = jax.jit(play)(jnp.int32(index))
        assert_equal(jax.tree.map(lambda x, p=place: x[p], together), alone, DRIFT)


def test_planning_equals_multi_agent_with_only_the_ego_controlled() -> None:
    bank, bicycle = worlds.bank("generated"), dynamics.build("bicycle")
    parts = IDM, vector(SMALL)
    reward = rewards.weighted(rewards.SPARSE)
    alone = planning(bicycle, *parts, reward, CHEAP)
    team = Team(bicycle, controlled.ego)
    among = multi_agent((team,), *parts, reward, CHEAP)
    one = played(alone, bank, 0, wild()[:, 0])
    all_ = played(among, bank, 0, (wild(),))
    assert_equal(all_.state, one.state, DRIFT)
    shared = jax.tree.map(
        lambda leaf: leaf[:, 0], all_.timestep.replace(truncated=all_.state.admitted)
    )
    assert_equal(
        shared.replace(truncated=()), one.timestep.replace(truncated=()), DRIFT
    )
    assert not all_.timestep.acted[:, 1:].any()
    assert not all_.timestep.measures["collision"].valid[:, 1:].any()
