"""Tests the running of red lights against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.metrics import red_light
from drivetrain.sim.metrics.base import Measure, Moment
from drivetrain.sim.motion import Motion
from drivetrain.sim.scenario import LANES, LightState, Scenario
from tests import changes, worlds
from tests.oracles import geometry, metrics as oracle

NUM_STEPS = 6  # of a scenario that are looked at, and as many at which lights change
SPREAD = (2.0, 1.2, 2.5)  # metres that objects are apart from their stop points


@jax.jit
def measured(moment: Moment) -> Measure:
    """Returns the metric of all objects."""
    numbers = jnp.arange(len(moment.after.valid))
    return jax.vmap(red_light.measure, in_axes=(None, 0))(moment, numbers)


def lights_of(scenario: Scenario, step: int) -> list[oracle.Light]:
    """Returns the lights whose lanes are known, in the frame of the scenario."""
    lights, roads, found = scenario.lights, scenario.roads, []
    for i in np.flatnonzero(lights.valid[:, step - 1] & lights.valid[:, step]):
        is_lane = np.isin(roads.map_type, LANES)
        lanes = np.flatnonzero(is_lane & (roads.feature_id == lights.lane_id[i]))
        if len(lanes):
            lane = roads.points_of(int(lanes[0]))[:, :2]
            before, after = (
                LightState(s).name for s in lights.state[i, step - 1 :][:2]
            )
            yaw = geometry.direction_at(lights.xyz[i, :2], lane)
            xyz = lights.xyz[i] - scenario.origin
            found.append(oracle.Light(xyz, yaw, (before, after)))
    return found


def steps_of(scenario: Scenario) -> list[int]:
    """Returns some steps, and some at which a light changes."""
    state = scenario.lights.state
    changes = 1 + np.flatnonzero((state[:, 1:] != state[:, :-1]).any(axis=0))
    some = np.linspace(11, 90, NUM_STEPS).astype(int)
    return sorted({*some.tolist(), *changes[-NUM_STEPS:].tolist()})


def at_the_lights(moment: Moment, lights: list[oracle.Light], seed: int) -> Moment:
    """Moves everybody to some stop point, most of them to pass it."""
    rng = np.random.default_rng(seed)
    num_objects = len(moment.after.valid)
    light = [lights[i] for i in rng.integers(len(lights), size=num_objects)]
    lane = np.array([one.yaw for one in light])
    yaw = (
        lane + rng.normal(0, 0.5, num_objects) + np.pi * (rng.random(num_objects) < 0.1)
    )
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    xyz = np.array([one.xyz for one in light]) + rng.normal(0, SPREAD, (num_objects, 3))
    xyz[:, :2] -= forward * np.asarray(moment.object_size)[:, :1] / 2
    travel = rng.uniform(0, 3, (num_objects, 1)) * forward

    def motion(xyz: np.ndarray, of: Motion) -> Motion:
        moved = of.replace(xyz=xyz, yaw=(yaw + np.pi) % (2 * np.pi) - np.pi)
        return worlds.filled(moved.replace(velocity=np.zeros((num_objects, 2))), 0.0)

    ahead = xyz + np.pad(travel, [(0, 0), (0, 1)])
    return moment.replace(
        before=motion(xyz, moment.before), after=motion(ahead, moment.after)
    )


def answers(moment: Moment, number: int, lights: list[oracle.Light]) -> set[bool]:
    """Returns what the oracle says, with the object moved by up to a millimetre."""
    length, width, _ = np.float64(moment.object_size[number])
    poses = [
        (np.float64(motion.xy[number]), float(motion.yaw[number]))
        for motion in (moment.before, moment.after)
    ]
    z = float(moment.after.xyz[number, 2])
    found = set()
    for nudge in worlds.NUDGES:
        before, after = (
            geometry.Box(xy + nudge, yaw, length, width) for xy, yaw in poses
        )
        found.add(oracle.runs_red_light(before, after, z, lights))
    return found


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_red_lights_are_run_where_the_oracle_says(kind: str) -> None:
    count = []
    for index, scenario in enumerate(worlds.scenarios(kind)):
        scene = worlds.scene(worlds.bank(kind), index)
        for step in steps_of(scenario):
            lights = lights_of(scenario, step)
            if not lights:
                continue
            moment = at_the_lights(worlds.moment_of(scene, step, step), lights, step)
            found = measured(moment)
            valid = np.asarray(moment.before.valid & moment.after.valid)
            np.testing.assert_array_equal(found.valid, valid)
            for i in np.flatnonzero(valid):
                runs = bool(found.value[i] > 0)
                assert runs in answers(moment, i, lights)
                count.append(runs)
            assert not np.any(found.value[~valid])
    assert 0.05 < np.mean(count) < 0.95  # else the samples prove nothing
    assert len(count) > 100


@pytest.mark.parametrize("change", changes.CHANGES)
def test_verdicts_are_kept(change: str) -> None:
    changes.assert_kept(change, "red_light", 0)
