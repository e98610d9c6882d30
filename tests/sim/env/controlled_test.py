"""Tests of the sets of objects that teams control."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.env import controlled
from drivetrain.sim.env.controlled import MovingConfig
from drivetrain.sim.scenario import ObjectType
from tests import worlds

BUSY = 0  # a generated scenario with all kinds of objects, of whom some join late


def test_sets_by_type_share_out_all_objects() -> None:
    scene = worlds.scene(worlds.bank("generated"), BUSY)
    kinds = worlds.scenarios("generated")[BUSY].tracks.object_type
    sets = (controlled.vehicles, controlled.pedestrians, controlled.cyclists)
    masks = np.array([of_type(scene) for of_type in sets])
    counts = [np.sum(kinds == kind) for kind in (1, 2, 3)]
    np.testing.assert_array_equal(masks.sum(axis=1), counts)
    np.testing.assert_array_equal(masks.sum(axis=0), controlled.everyone(scene))
    both = controlled.of_type(ObjectType.PEDESTRIAN, ObjectType.CYCLIST)(scene)
    np.testing.assert_array_equal(both, masks[1] | masks[2])


def test_the_ego_is_the_first_object() -> None:
    mask = controlled.ego(worlds.scene(worlds.bank("generated"), BUSY))
    np.testing.assert_array_equal(np.flatnonzero(mask), [0])


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_moving_vehicles_are_those_of_the_tracks_that_move(kind: str) -> None:
    bank = worlds.bank(kind)
    moving = jax.jit(controlled.moving_vehicles())
    for index, scenario in enumerate(worlds.scenarios(kind)):
        tracks, now = scenario.tracks, scenario.current_step
        scene = worlds.scene(bank, index)
        expected = []
        for i in worlds.order_of(scenario, len(scene.object_mask)):
            steps = np.flatnonzero(tracks.valid[i])
            speed = np.linalg.norm(tracks.velocity[i, steps], axis=-1).max()
            way = tracks.xyz[i, steps[-1], :2] - tracks.xyz[i, now, :2]
            moves = speed > 0.05 or np.linalg.norm(way) > 0.2
            is_here = tracks.valid[i, now] and tracks.object_type[i] == 1
            expected.append(bool(is_here and moves))
        feasible = np.asarray(scene.goal_feasible)[: len(expected)]
        mask = moving(scene)[: len(expected)]
        np.testing.assert_array_equal(mask, expected & feasible)


def test_at_most_so_many_vehicles_are_controlled() -> None:
    scene = worlds.scene(worlds.bank("generated"), BUSY)
    few = controlled.moving_vehicles(MovingConfig(max_objects=3))(scene)
    all_ = np.flatnonzero(controlled.moving_vehicles()(scene))
    np.testing.assert_array_equal(np.flatnonzero(few), all_[:3])


def test_what_cannot_reach_its_goal_is_not_controlled() -> None:
    scene = worlds.scene(worlds.bank("generated"), BUSY)
    nobody = jnp.zeros_like(scene.bank.goal_feasible)
    scene = scene.replace(bank=scene.bank.replace(goal_feasible=nobody))
    assert not controlled.moving_vehicles()(scene).any()


def test_a_set_of_nobody_is_refused() -> None:
    with pytest.raises(ValueError, match="max_objects must be at least 1, got 0"):
        MovingConfig(max_objects=0)
