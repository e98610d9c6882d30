"""Tests which goals can be reached on the road against a plain loop."""

import numpy as np
import pytest
from jaxtyping import Float

from drivetrain.sim.data.feasibility import goal_feasible
from drivetrain.sim.scenario import Scenario
from tests import worlds
from tests.oracles import metrics as oracle
from tests.oracles.geometry import Box

LEVEL = 3.0  # metres
STRIDE = 10  # of the steps that are looked at
MOST = 20  # objects
NEAR_TOUCH = 1e-9  # metres by which boxes vary; float64 at some kilometres


def pushed(scenario: Scenario, seed: int) -> Float[np.ndarray, "objects steps 3"]:
    """Returns the log of objects, half of them moved to somewhere near an edge."""
    rng = np.random.default_rng(seed)
    xyz = scenario.tracks.xyz[:MOST, ::STRIDE] - scenario.origin
    place = rng.choice(np.concatenate(worlds.edges_of(scenario)), len(xyz))
    place += rng.normal(0, (0.7, 0.7, 2), (len(xyz), 3))
    shift = place - xyz[:, 11 // STRIDE]
    return xyz + shift[:, None] * (rng.random((len(xyz), 1, 1)) < 0.5)


def of(scenario: Scenario, xyz: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Returns which goals are found feasible."""
    edges = worlds.edges_of(scenario)
    joined = np.concatenate([np.arange(len(e)) < len(e) - 1 for e in edges])
    tracks = scenario.tracks
    yaw, size = tracks.yaw[:MOST, ::STRIDE], tracks.size[:MOST]
    return goal_feasible(xyz, yaw, size, valid, np.concatenate(edges), joined)


def by_loop(scenario: Scenario, xyz: np.ndarray, extra: float) -> np.ndarray:
    """Returns which objects touch no edge, their boxes larger by a length."""
    segments = oracle.segments_of(worlds.edges_of(scenario))
    tracks, feasible = scenario.tracks, np.ones(len(xyz), bool)
    for i, step in np.argwhere(tracks.valid[:MOST, ::STRIDE]):
        if not feasible[i]:
            continue
        length, width, _ = tracks.size[i] * (0.3, 0.1, 1) + extra
        box = Box(xyz[i, step, :2], tracks.yaw[i, step * STRIDE], length, width)
        feasible[i] = not oracle.edge_contact(box, xyz[i, step, 2], segments, LEVEL)
    return feasible


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_a_goal_is_feasible_if_no_step_of_the_log_touches_an_edge(kind: str) -> None:
    counts = np.zeros(2, int)
    for seed, scenario in enumerate(worlds.scenarios(kind)):
        xyz = pushed(scenario, seed)
        found = of(scenario, xyz, scenario.tracks.valid[:MOST, ::STRIDE])
        less, more = (
            by_loop(scenario, xyz, extra) for extra in (-NEAR_TOUCH, NEAR_TOUCH)
        )
        assert ((found == less) | (found == more)).all()
        counts += np.bincount(found, minlength=2)
    assert counts.min() > 10  # else the scenarios prove nothing


def test_what_is_not_valid_has_no_part() -> None:
    scenario = worlds.scenarios("generated")[0]
    xyz = pushed(scenario, 0)
    valid = scenario.tracks.valid[:MOST, ::STRIDE] & (np.arange(xyz.shape[1]) < 9)
    on_edge = np.where(valid[..., None], xyz, worlds.edges_of(scenario)[0][5])
    np.testing.assert_array_equal(
        of(scenario, on_edge, valid), of(scenario, xyz, valid)
    )


def test_without_edges_every_goal_is_feasible() -> None:
    tracks = worlds.scenarios("generated")[0].tracks
    nothing = np.zeros((0, 3)), np.zeros(0, bool)
    found = goal_feasible(tracks.xyz, tracks.yaw, tracks.size, tracks.valid, *nothing)
    assert found.all()


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_scenes_show_whose_goal_is_feasible(kind: str) -> None:
    for index, scenario in enumerate(worlds.scenarios(kind)):
        scene, edges = worlds.scene(worlds.bank(kind), index), worlds.edges_of(scenario)
        joined = np.concatenate([np.arange(len(e)) < len(e) - 1 for e in edges])
        tracks = scenario.tracks
        xyz = tracks.xyz - scenario.origin
        found = goal_feasible(
            xyz, tracks.yaw, tracks.size, tracks.valid, np.concatenate(edges), joined
        )
        expected = np.zeros(len(scene.object_mask), bool)
        order = worlds.order_of(scenario, len(expected))
        expected[: len(order)] = found[order]
        np.testing.assert_array_equal(scene.goal_feasible, expected)
