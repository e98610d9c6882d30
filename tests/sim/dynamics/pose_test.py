"""Tests that the pose dynamics put objects where they are told."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim.dynamics.pose import pose
from drivetrain.sim.motion import Motion
from tests import worlds

DT = 0.1


def test_the_log_is_played_back_without_rounding() -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    motion = worlds.log_at(scene, jnp.int32(10))
    there = np.ones_like(np.asarray(motion.valid))
    for step in range(11, 31):
        logged = worlds.log_at(scene, jnp.int32(step))
        size = worlds.car_size(motion)
        motion = pose().forward(
            motion, size, pose().inverse(motion, logged, size, DT), DT
        )
        there &= np.asarray(logged.valid)
        np.testing.assert_array_equal(motion.xy[there], logged.xy[there])
        np.testing.assert_array_equal(motion.velocity[there], logged.velocity[there])
        # Wrapping an angle rounds it.
        np.testing.assert_allclose(motion.yaw[there], logged.yaw[there], atol=1e-6)
    assert there.sum() > 1


def test_the_action_is_the_state() -> None:
    before, _ = worlds.kicked_pairs("generated")
    action = jnp.tile(jnp.array([3.0, -4.0, 7.0, 5.0, -6.0]), (len(before.yaw), 1))
    after: Motion = pose().forward(before, worlds.car_size(before), action, DT)
    np.testing.assert_array_equal(after.xy, action[:, :2])
    np.testing.assert_allclose(after.yaw, 7.0 - 2 * np.pi, rtol=1e-6)
    np.testing.assert_array_equal(after.velocity, action[:, 3:])


def test_the_gradient_is_that_of_the_identity() -> None:
    before, _ = worlds.kicked_pairs("generated")
    one = jax.tree.map(lambda leaf: leaf[0], before)

    def state(action):
        after = pose().forward(one, worlds.car_size(one), action, DT)
        return jnp.concatenate([after.xy, after.yaw[None], after.velocity])

    action = jnp.array([3.0, -4.0, 7.0, 5.0, -6.0])
    np.testing.assert_array_equal(jax.jacobian(state)(action), np.eye(5))
