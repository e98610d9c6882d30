"""Tests playback against the log as it was read."""

import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.sim_agents.playback import PLAYBACK
from tests import worlds

SPEED_ROUNDING = 1e-5  # metres per second; float32 at 50 m/s
TURN_ROUNDING = 1e-6  # radians; float32 below pi


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_every_object_does_what_it_did(kind: str) -> None:
    for index, scenario in enumerate(worlds.scenarios(kind)):
        scene = worlds.scene(worlds.bank(kind), index)
        tracks = scenario.tracks
        order = worlds.order_of(scenario, worlds.MAX_OBJECTS)
        motion = worlds.log_at(scene, scene.current_step)
        for step in (scenario.current_step, 30, 31, 32, scenario.num_steps - 2):
            _, after = PLAYBACK.step(scene, (), motion, jnp.int32(step))
            after = worlds.filled(after, 0.0)
            here = tracks.valid[order, step + 1]
            seen = np.asarray(after.valid)
            np.testing.assert_array_equal(seen[: len(order)], here)
            assert not seen[len(order) :].any()
            kept = order[here]
            at = np.flatnonzero(seen)
            np.testing.assert_allclose(
                after.xyz[at],
                tracks.xyz[kept, step + 1] - scenario.origin,
                rtol=0,
                atol=worlds.ROUNDING,
            )
            np.testing.assert_allclose(
                after.velocity[at],
                tracks.velocity[kept, step + 1],
                rtol=0,
                atol=SPEED_ROUNDING,
            )
            turn = np.asarray(after.yaw)[at] - tracks.yaw[kept, step + 1]
            wrapped = (turn + np.pi) % (2 * np.pi) - np.pi
            np.testing.assert_allclose(wrapped, 0, atol=TURN_ROUNDING)


@pytest.mark.parametrize("step", [-2, 90, 500])
def test_outside_the_log_nobody_is_there(step: int) -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    motion = worlds.log_at(scene, scene.current_step)
    _, after = PLAYBACK.step(scene, (), motion, jnp.int32(step))
    assert not np.any(after.valid)
    np.testing.assert_array_equal(after.xyz, 0)
