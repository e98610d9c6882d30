"""Tests collisions, edge contacts and goals against the published Nocturne.

Its boxes collide where they touch, ours where they share area: no box of the oracle
lies on that line. Where a vehicle meets both, Nocturne's type names the edge.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from drivetrain.sim.goals import logged_goal
from drivetrain.sim.metrics.base import Measure, Moment
from drivetrain.sim.metrics.build import measure_all
from drivetrain.sim.metrics.collision import COLLISION
from drivetrain.sim.metrics.edge_contact import edge_contact
from drivetrain.sim.metrics.goal import GOAL
from drivetrain.sim.motion import Motion
from drivetrain.sim.scene import Scene
from tests import nocturne, worlds

MANY = 64  # objects: no cap
VEHICLE, EDGE = 1, 2  # types of collision
POLICIES = ("expert", "random")
# Nocturne rounds places of 9 km to float32 [m].
PLACE = 1e-3
TURN = 1e-6  # radians: float32
SPEED = 1e-6  # metres per second, likewise


def scene_of(name: str) -> Scene:
    bank = worlds.bank_of([worlds.exact(nocturne.scenario(name))], MANY)
    return worlds.scene(bank, 0)


def measured(
    name: str, ids: np.ndarray, state: Float[np.ndarray, "moments n 4"]
) -> dict[str, Measure]:
    """Measures the objects of some moments: x, y, yaw and speed, NaN where absent."""
    scene, rows = scene_of(name), nocturne.rows_of(name, ids)

    def everybody(values: np.ndarray) -> jax.Array:
        shape = len(state), scene.bank.sizes.num_objects, *values.shape[2:]
        filled = np.zeros(shape, values.dtype)
        filled[:, rows] = values
        return jnp.asarray(filled)

    state = np.float64(state)
    valid = ~np.isnan(state[..., 0])
    state = np.where(valid[..., None], state, 0.0)
    yaw, speed = state[..., 2], state[..., 3]
    origin = nocturne.scenario(name).origin
    xyz = np.pad(state[..., :2], [(0, 0), (0, 0), (0, 1)])
    xyz = np.where(valid[..., None], xyz - origin * (1, 1, 0), 0.0)
    velocity = speed[..., None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    motion = Motion(
        xyz=everybody(np.float32(xyz)),
        yaw=everybody(np.float32(yaw)),
        velocity=everybody(np.float32(velocity)),
        valid=everybody(valid),
    )

    @jax.jit
    def measure(scene: Scene, motion: Motion) -> dict[str, Measure]:
        start = scene.log_at(scene.current_step)

        def one(motion: Motion) -> dict[str, Measure]:
            moment = Moment(
                scene=scene,
                object_size=scene.object_size,
                step=scene.current_step + 1,
                before=start,
                after=motion,
                logged=start,
                goal=logged_goal(scene, start),
            )
            return measure_all(moment, (COLLISION, edge_contact(math.inf), GOAL))

        return jax.vmap(one)(motion)

    return jax.tree.map(lambda leaf: leaf[:, rows], measure(scene, motion))


@pytest.mark.parametrize("scene", nocturne.SCENES)
def test_collisions_and_their_types_are_those_of_nocturne(scene: str) -> None:
    ids = nocturne.oracle(f"obs_{scene}")["veh_id"]
    oracle = nocturne.oracle(f"collision_{scene}")
    measures = measured(scene, ids, oracle["state"])
    hit = np.asarray(measures["collision"].value) > 0
    edge = np.asarray(measures["edge_contact"].value) > 0
    np.testing.assert_array_equal(hit | edge, oracle["coll"][..., 0])
    kind = np.where(edge, EDGE, np.where(hit, VEHICLE, 0))
    np.testing.assert_array_equal(kind, oracle["coll"][..., 1])
    assert len(np.unique(kind)) == 3  # else the placements prove nothing


@pytest.mark.parametrize("scene", nocturne.SCENES)
def test_goals_are_those_of_nocturne(scene: str) -> None:
    oracle = nocturne.oracle(f"env_{scene}_expert_0")
    view = scene_of(scene)
    rows = nocturne.rows_of(scene, oracle["ids"])
    start = worlds.log_at(view, view.current_step)
    goal = jax.tree.map(lambda leaf: np.asarray(leaf)[rows], logged_goal(view, start))
    target = np.float64(oracle["target"])
    xy = goal.motion.xyz[:, :2] + nocturne.scenario(scene).origin[:2]
    np.testing.assert_allclose(xy, target[:, :2], rtol=0, atol=PLACE)
    turn = goal.motion.yaw - target[:, 2]
    assert np.abs((turn + np.pi) % (2 * np.pi) - np.pi).max() < TURN
    speed = np.linalg.norm(goal.motion.velocity, axis=-1)
    np.testing.assert_allclose(speed, target[:, 3], rtol=SPEED, atol=SPEED)
    np.testing.assert_allclose(goal.distance, oracle["goal_norm"], rtol=0, atol=PLACE)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("scene", nocturne.SCENES)
def test_goals_are_reached_where_nocturne_says(scene: str, policy: str) -> None:
    oracle = nocturne.oracle(f"env_{scene}_{policy}_0")
    goal = measured(scene, oracle["ids"], oracle["state"][1:])["goal"]
    acted = ~np.isnan(oracle["state"][1:, :, 0])
    np.testing.assert_array_equal(goal.valid, acted)
    np.testing.assert_array_equal(goal.value[acted], oracle["info"][..., 0][acted])
