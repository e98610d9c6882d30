"""Tests that futures are the log, as the ego sees it from where it was."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim.data.stratum import whole
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env.futures import futures
from drivetrain.sim.env.logged_views import logged_view
from drivetrain.sim.metrics.build import EGO
from drivetrain.sim.observations.vector import vector
from tests import worlds
from tests.sim.env.planning_test import SMALL

NUM_STEPS = 80
# Differences of float32 places up to 300 m from the origin, which step by 3e-5 m.
ROUNDING = 2e-4


def test_poses_are_the_log_seen_from_the_ego_and_end_with_it() -> None:
    bank, moves, observer = (
        worlds.bank("generated"),
        dynamics.build("delta"),
        vector(SMALL),
    )
    draw = jax.jit(futures(moves, observer, NUM_STEPS))
    look = jax.jit(lambda bank, key: logged_view(moves, observer, bank, whole(), key))
    log_of = jax.jit(lambda scene: scene.log_of(jnp.int32(EGO)))
    ends = set()
    for seed in range(8):
        key = jax.random.key(seed)
        future, view = draw(bank, whole(), key), look(bank, key)
        step, index = int(view.step), int(view.scene.index)
        log = log_of(worlds.scene(bank, index))
        last = int(bank.num_steps[index]) - 1
        ends.add(last - step)
        xy, yaw, valid = (np.asarray(x, float) for x in (log.xy, log.yaw, log.valid))
        x, y = (xy - xy[step]).T
        cos, sin = np.cos(yaw[step]), np.sin(yaw[step])
        seen = np.stack([cos * x + sin * y, cos * y - sin * x, yaw - yaw[step]], axis=1)
        for ahead in range(1, NUM_STEPS + 1):
            found, there = future.poses[ahead - 1], future.mask[ahead - 1]
            assert there == (step + ahead <= last and valid[step + ahead] > 0)
            off = np.asarray(found) - (seen[step + ahead] if there else 0.0)
            off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
            assert np.abs(off).max() < ROUNDING
    assert len(ends) > 4 and min(ends) < NUM_STEPS
