"""Tests constant speed against the path of the oracle, over whole episodes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.scene import Scene
from drivetrain.sim.sim_agents.constant_speed import CONSTANT_SPEED
from tests import worlds
from tests.oracles.idm import MIN_REACH, Path

NUM_STEPS = 80
DT = 0.1
# The speed of 30 m/s, rounded to 2e-6, over 8 s, and positions; see `worlds.ROUNDING`.
ROUNDING = 2e-3  # metres


@jax.jit
def play(scene: Scene):
    """Holds everybody's speed."""

    def step(carry, number):
        memory, motion = CONSTANT_SPEED.step(scene, *carry, number)
        return (memory, motion), motion

    start = scene.current_step
    first = CONSTANT_SPEED.reset(scene), scene.log_at(start)
    return jax.lax.scan(step, first, start + jnp.arange(NUM_STEPS))[1]


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_speed_is_held_along_the_logged_way(kind: str) -> None:
    num_driven = 0
    for index, scenario in enumerate(worlds.scenarios(kind)):
        played = play(worlds.scene(worlds.bank(kind), index))
        tracks, now = scenario.tracks, scenario.current_step
        for slot, track in enumerate(worlds.order_of(scenario, worlds.MAX_OBJECTS)):
            steps = now + np.flatnonzero(tracks.valid[track, now:])
            xy = (tracks.xyz[track] - scenario.origin)[:, :2]
            if not tracks.valid[track, now]:
                continue
            path = Path(xy[steps], tracks.yaw[track, steps])
            if np.linalg.norm(path.xy - path.xy[0], axis=1).max() < MIN_REACH:
                continue
            num_driven += 1
            speed = float(np.linalg.norm(tracks.velocity[track, now]))
            arcs = speed * DT * np.arange(1, NUM_STEPS + 1)
            expected = [path.pose(arc) for arc in arcs]
            np.testing.assert_allclose(
                played.xy[:, slot], [xy for xy, _ in expected], rtol=0, atol=ROUNDING
            )
            np.testing.assert_allclose(played.speed[:, slot], speed, rtol=1e-5)
            assert np.asarray(played.valid)[:, slot].all()
    assert num_driven > 10  # else the samples prove nothing


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_whoever_stays_does_what_the_log_says(kind: str) -> None:
    for index in range(len(worlds.scenarios(kind))):
        scene = worlds.scene(worlds.bank(kind), index)
        driven = np.asarray(CONSTANT_SPEED.reset(scene).is_driven)
        played = play(scene)
        for step in (0, 40, 79):
            logged = worlds.log_at(scene, scene.current_step + step + 1)
            for ours, log in zip(
                jax.tree.leaves(played), jax.tree.leaves(logged), strict=True
            ):
                np.testing.assert_array_equal(ours[step][~driven], log[~driven])
