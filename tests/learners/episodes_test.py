"""Tests that what is told of training episodes is what happened in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import episodes
from drivetrain.learners.acting import Step
from drivetrain.sim.metrics.base import Measure

NUM_STEPS, NUM_WORLDS = 60, 3
ROUNDING = 1e-5  # float32 sums of some tens of numbers of order one


def play(seed: int, actors: tuple[int, ...]) -> Step:
    """Draws the steps of an unroll; after the last of an episode nobody acts."""
    rng = np.random.default_rng(seed)
    shape = (NUM_STEPS, NUM_WORLDS, *actors)
    ended = rng.random(shape[:2]) < 0.15
    ended[1:] &= ~ended[:-1]
    shown = np.zeros_like(ended)
    shown[1:] = ended[:-1]
    lasting = rng.random((NUM_WORLDS, *actors)) < 0.8  # some never act
    mask = lasting & ~shown.reshape(*shown.shape, *[1] * len(actors))
    valid = mask & (rng.random(shape) < 0.3)
    value = (rng.random(shape) < 0.4).astype(np.float32)
    reward = np.where(mask, rng.normal(size=shape), 0.0).astype(np.float32)
    step = Step(
        observation={},
        action=np.zeros(shape, np.int32),
        note=(),
        reward=reward,
        discount=np.ones(shape, np.float32),
        mask=mask,
        ended=ended,
        measures={
            "collision": Measure(value=value, valid=valid),
            "log_displacement": Measure(value=value, valid=valid),
        },
    )
    return jax.tree.map(jnp.asarray, step)


def tally(steps: Step) -> dict[str, tuple[float, float]]:
    """Counts in plain loops, world by world and actor by actor."""
    sums = {name: [0.0, 0] for name in ("return", "length", "collision")}
    reward, mask, ended = (
        np.asarray(x) for x in (steps.reward, steps.mask, steps.ended)
    )
    collision = jax.tree.map(np.asarray, steps.measures["collision"])
    flat = (NUM_STEPS, NUM_WORLDS, -1)
    reward, mask = reward.reshape(flat), mask.reshape(flat)
    value, valid = collision.value.reshape(flat), collision.valid.reshape(flat)
    for world in range(NUM_WORLDS):
        start = 0
        for last in np.flatnonzero(ended[:, world]):
            part = slice(start, last + 1)
            start = last + 1
            for actor in range(reward.shape[2]):
                here = (part, world, actor)
                if mask[here].any():
                    sums["return"][0] += reward[here].astype(float).sum()
                    sums["length"][0] += mask[here].sum()
                    sums["return"][1] += 1
                    sums["length"][1] += 1
                if valid[here].any():
                    sums["collision"][0] += (value[here] * valid[here]).any()
                    sums["collision"][1] += 1
    return {name: (total, count) for name, (total, count) in sums.items()}


def begin(steps: Step) -> episodes.Episodes:
    one = jax.eval_shape(lambda: jax.tree.map(lambda leaf: leaf[0, 0], steps))
    return jax.tree.map(
        lambda leaf: jnp.stack([leaf] * NUM_WORLDS), episodes.begin(one)
    )


@pytest.mark.parametrize("actors", [(), (4,)])
def test_means_over_unrolls_are_those_of_whole_episodes(
    actors: tuple[int, ...],
) -> None:
    steps = play(0, actors)
    running = begin(steps)
    totals: dict[str, np.ndarray] = {}
    for start in range(0, NUM_STEPS, 20):
        part = jax.tree.map(lambda leaf: leaf[start : start + 20], steps)  # noqa: B023
        running, metrics = jax.jit(episodes.track)(running, part)
        for name, mean in metrics.items():
            found = np.array([mean.total, mean.weight])
            totals[name] = totals.get(name, 0) + found
    expected = {f"episode/{name}": pair for name, pair in tally(steps).items()}
    assert totals.keys() == expected.keys()
    for name, pair in expected.items():
        assert pair[1] > 5
        np.testing.assert_allclose(totals[name], pair, rtol=ROUNDING, atol=ROUNDING)


def test_an_episode_that_goes_on_is_not_counted_yet() -> None:
    steps = play(1, ())
    steps = steps.replace(ended=jnp.zeros_like(steps.ended))
    running, metrics = episodes.track(begin(steps), steps)
    assert all(mean.weight == 0 for mean in metrics.values())
    np.testing.assert_array_equal(running.num_steps, steps.mask.sum(axis=0))
