"""Tests rewards: sums of metrics, Nocturne's, and what shaping adds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import rewards
from drivetrain.sim.goals import Goal
from drivetrain.sim.metrics.base import Measure, Moment
from drivetrain.sim.metrics.goal import GOAL
from drivetrain.sim.motion import Motion
from tests import nocturne, worlds

EGO = jnp.int32(0)
NOCTURNE_ROUNDING = 1e-6  # float32: numbers of some 100 m over distances of metres
SUM_ROUNDING = 1e-4  # float32: a sum of 40 differences of numbers below 100
SHAPED_STEPS = 40
WEIGHT = 2.5  # of a metre


def measure(value: float, valid: bool = True) -> Measure:
    return Measure(value=jnp.float32(value), valid=jnp.array(valid))


def test_the_sparse_reward_counts_collision_and_offroad() -> None:
    reward = rewards.weighted(rewards.SPARSE)
    moment = worlds.samples("generated")[0].moment
    for collision, offroad, expected in ((0, 0, 0), (1, 0, -1), (0, 1, -1), (1, 1, -2)):
        measures = {"collision": measure(collision), "offroad": measure(offroad)}
        assert float(reward(moment, EGO, measures)) == expected


def test_a_measure_that_is_not_valid_counts_as_zero() -> None:
    reward = rewards.weighted({"collision": -1.0})
    measures = {"collision": measure(1.0, valid=False)}
    moment = worlds.samples("generated")[0].moment
    assert float(reward(moment, EGO, measures)) == 0.0


def motion_of(state: np.ndarray, origin: np.ndarray) -> Motion:
    """Returns the motion of objects from x, y, yaw and speed; NaN is absent."""
    valid = ~np.isnan(state[:, 0])
    x, y, yaw, speed = np.where(valid[:, None], state, 0.0).T
    xyz = np.stack([x - origin[0], y - origin[1], 0 * x], axis=-1)
    velocity = speed[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    motion = Motion(xyz=xyz, yaw=yaw, velocity=velocity, valid=valid)
    return worlds.filled(motion, 0.0)


@jax.jit
def dense(moment: Moment) -> jax.Array:
    """Returns Nocturne's reward of all objects."""

    def one(number: jax.Array) -> jax.Array:
        measures = {"goal": GOAL.measure(moment, number)}
        return rewards.nocturne_dense()(moment, number, measures)

    return jax.vmap(one)(jnp.arange(len(moment.after.valid)))


@pytest.mark.parametrize("policy", ["expert", "random"])
@pytest.mark.parametrize("name", nocturne.SCENES)
def test_the_dense_reward_is_that_of_nocturne(name: str, policy: str) -> None:
    oracle = nocturne.oracle(f"env_{name}_{policy}_0")
    origin = oracle["target"][0].astype(np.float64)
    goal = Goal(
        motion=motion_of(oracle["target"].astype(np.float64), origin),
        distance=jnp.asarray(oracle["goal_norm"], jnp.float32),
    )
    sample = worlds.samples("generated")[0].moment
    count = 0
    for step, state in enumerate(oracle["state"][1:].astype(np.float64)):
        after = motion_of(state, origin)
        found = dense(sample.replace(after=after, goal=goal))
        here = np.asarray(after.valid)
        difference = found[here] - oracle["reward"][step][here]
        assert np.abs(difference).max(initial=0) < NOCTURNE_ROUNDING
        assert not np.any(found[~here])
        count += here.sum()
    assert count > 100  # else the oracle proves nothing


def test_the_gradient_of_the_dense_reward_is_finite_at_the_goal() -> None:
    moment = worlds.samples("generated")[0].moment
    start = jnp.zeros_like(moment.goal.distance)

    def total(after: Motion, distance: jax.Array) -> jax.Array:
        goal = moment.goal.replace(motion=moment.logged, distance=distance)
        return jnp.sum(dense(moment.replace(after=after, goal=goal)))

    for distance in (start, start + 1):
        for after in (moment.logged, moment.after):
            gradient = jax.grad(total, allow_int=True)(after, distance)
            for name in ("xyz", "yaw", "velocity"):
                assert np.isfinite(getattr(gradient, name)).all()


@pytest.mark.parametrize("is_over", [False, True])
@pytest.mark.parametrize("discount", [1.0, 0.9])
@pytest.mark.parametrize(
    "potential", [rewards.nearness_to_goal, rewards.nearness_to_log]
)
def test_shaping_adds_what_the_potential_gained(
    potential, discount: float, is_over: bool
) -> None:
    first = worlds.samples("generated")[0].moment
    steps = [int(first.step) + i for i in range(SHAPED_STEPS + 1)]
    logs = [worlds.log_at(first.scene, jnp.int32(step)) for step in steps]
    walk = [worlds.kicked(log, step) for log, step in zip(logs, steps, strict=True)]
    bumpy = rewards.weighted({"collision": 0.5})
    reward = rewards.shaped(bumpy, potential, WEIGHT, discount, ends=["goal"])

    @jax.jit
    def gain(moment: Moment, reached: jax.Array) -> jax.Array:
        measures = {"collision": measure(1.0), "goal": measure(reached)}
        return reward(moment, EGO, measures) - 0.5

    gains = [
        gain(
            first.replace(step=jnp.int32(s), before=b, after=a, logged=log),
            jnp.float32(is_over and s == steps[-1]),
        )
        for s, b, a, log in zip(steps[1:], walk, walk[1:], logs[1:], strict=False)
    ]
    ends = {"goal": [first.goal.motion] * 2, "log": [logs[0], logs[-1]]}
    there = ends["goal" if potential is rewards.nearness_to_goal else "log"]
    before, after = (
        -np.linalg.norm(np.float64(motion.xy[0]) - np.float64(place.xy[0]))
        for motion, place in zip((walk[0], walk[-1]), there, strict=True)
    )
    total = sum(float(g) * discount**t for t, g in enumerate(gains))
    expected = WEIGHT * (discount**SHAPED_STEPS * after * (not is_over) - before)
    assert total == pytest.approx(expected, abs=SUM_ROUNDING)
    assert max(abs(float(g)) for g in gains) > 0.1  # else the walk proves nothing


def test_who_is_absent_has_no_potential() -> None:
    moment = worlds.samples("generated")[0].moment
    nobody = worlds.filled(
        moment.after.replace(valid=jnp.zeros_like(moment.after.valid)), 3.0
    )
    for potential in (rewards.nearness_to_goal, rewards.nearness_to_log):
        of = potential(moment.scene, moment.goal, nobody, moment.step, EGO)
        assert float(of) == 0.0


@pytest.mark.parametrize(
    ("weight", "discount", "message"),
    [
        (1.0, -0.1, "discount must lie between 0 and 1"),
        (1.0, 1.1, "discount must lie between 0 and 1"),
        (1.0, np.nan, "discount must lie between 0 and 1"),
        (0.0, 1.0, "weight must be positive"),
        (np.inf, 1.0, "weight must be positive"),
    ],
)
def test_shaping_out_of_range_is_refused(weight, discount, message: str) -> None:
    bare = rewards.weighted(rewards.SPARSE)
    with pytest.raises(ValueError, match=message):
        rewards.shaped(bare, rewards.nearness_to_goal, weight, discount)
