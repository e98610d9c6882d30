"""Tests that a recording is the log, then the rollout, with its metrics."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import drivers
from drivetrain.sim.env.recording import record
from drivetrain.sim.env.rollout import rollout
from tests import worlds
from tests.sim.env.planning_test import env_of


def test_a_recording_is_the_log_then_the_rollout() -> None:
    env, bank = env_of("bicycle"), worlds.bank("generated")
    driver = drivers.build("coast", dynamics.build("bicycle"))
    key, index = jax.random.key(0), jnp.int32(1)
    recording = jax.jit(lambda: record(env, driver, bank, index, key))()
    steps = jax.jit(lambda: rollout(env, driver, bank, index, key))()

    scene = worlds.scene(bank, 1)
    np.testing.assert_array_equal(
        recording.motion.xyz[7], worlds.log_at(scene, jnp.int32(7)).xyz
    )
    np.testing.assert_array_equal(recording.motion.xyz[11:], steps.motion.xyz)
    for name, measure in steps.measures.items():
        recorded = recording.measures[name]
        ego = recorded.value if recorded.value.ndim == 1 else recorded.value[:, 0]
        # One metric compiled in two programs: a rounding error of its last bit.
        np.testing.assert_allclose(ego[11:], measure.value, rtol=1e-5, atol=1e-5)
    assert not recording.measures["kinematic"].valid[0].any()
