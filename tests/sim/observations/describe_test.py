"""Tests that observations are what their observers say of them."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.observations.base import Observation, Observer
from drivetrain.sim.observations.compact import CompactConfig, compact
from drivetrain.sim.observations.nocturne import NocturneConfig, nocturne
from drivetrain.sim.observations.noise import NoiseConfig
from drivetrain.sim.observations.vector import VectorConfig, vector
from tests import worlds

NOISE = NoiseConfig(position=0.3, yaw=0.05, velocity=0.3)
# Of the vector, by name: all groups, and as few as there can be.
VECTORS = {
    "whole": vector(VectorConfig(history=2, num_road=32, goal=True, noise=NOISE)),
    "bare": vector(
        VectorConfig(
            history=0,
            road="points",
            num_road=32,
            num_lights=0,
            num_route=0,
            radius=30.0,
        )
    ),
}
OBSERVERS = VECTORS | {
    "compact": compact(CompactConfig(num_objects=7, num_road=32)),
    "nocturne": nocturne(NocturneConfig(num_road=64, num_lights=4)),
}
STEPS = (10, 45, 80)
ROUNDING = 1e-5  # float32 at 80 m, in units of 20 m


@functools.cache
def seen(name: str, kind: str) -> list[Observation]:
    """Returns what all objects see at some steps, some of them off the log."""
    observer = OBSERVERS[name]

    @jax.jit
    def look(view) -> Observation:
        numbers = jnp.arange(view.motion.valid.shape[1])
        return jax.vmap(observer.observe, in_axes=(None, 0))(view, numbers)

    looks = []
    for index in range(2):
        scene = worlds.scene(worlds.bank(kind), index)
        for step in STEPS:
            past = [
                worlds.log_at(scene, jnp.int32(step - back))
                for back in range(observer.history, 0, -1)
            ]
            now = worlds.kicked(worlds.log_at(scene, jnp.int32(step)), step)
            motion = jax.tree.map(lambda *leaves: jnp.stack(leaves), *past, now)
            looks.append(jax.device_get(look(worlds.view_of(scene, motion, step))))
    return looks


def groups_of(observer: Observer) -> dict[str, list]:
    """Returns the slots of each group, in order."""
    groups = {}
    for slot in observer.describe():
        groups.setdefault(slot.group, []).append(slot)
    return groups


@pytest.mark.parametrize("name", OBSERVERS)
def test_every_feature_of_every_group_is_named(name: str) -> None:
    groups = groups_of(OBSERVERS[name])
    (observation, *_) = seen(name, "generated")
    assert groups.keys() == observation.keys()
    for group, slots in groups.items():
        assert len(slots) == observation[group].values.shape[-1], group
        assert len({slot.feature for slot in slots}) == len(slots)


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("name", OBSERVERS)
def test_values_stay_in_the_ranges_said(name: str, kind: str) -> None:
    for group, slots in groups_of(OBSERVERS[name]).items():
        values = np.concatenate(
            [look[group].values.reshape(-1, len(slots)) for look in seen(name, kind)]
        )
        assert np.isfinite(values).all()
        for slot, low, high in zip(
            slots, values.min(axis=0), values.max(axis=0), strict=True
        ):
            assert slot.low <= 0 <= slot.high
            assert slot.low - ROUNDING <= low and high <= slot.high + ROUNDING, slot


@pytest.mark.parametrize("name", VECTORS)
def test_features_are_what_their_names_say(name: str) -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    observation = seen(name, "generated")[0]
    named = {
        group: {
            slot.feature: observation[group].values[..., place]
            for place, slot in enumerate(slots)
        }
        for group, slots in groups_of(OBSERVERS[name]).items()
    }
    ego = {feature: values[:, 0, -1] for feature, values in named["ego"].items()}
    here = observation["ego"].mask[:, 0, -1]
    kind = np.where(here, scene.object_type, 0)
    for code, feature in enumerate(("vehicle", "pedestrian", "cyclist"), start=1):
        np.testing.assert_array_equal(ego[f"is_{feature}"], kind == code)
    np.testing.assert_array_equal(ego["cos_yaw"], here)
    np.testing.assert_array_equal(ego["sin_yaw"], 0)
    size = np.where(here[:, None], scene.object_size, 0.0)
    for column, feature in enumerate(("length", "width")):
        np.testing.assert_allclose(5.0 * ego[feature], size[:, column], rtol=1e-6)
    map_kinds = [f for f in named["road"] if f.startswith("is_")]
    total = sum(named["road"][feature] for feature in map_kinds)
    np.testing.assert_array_equal(total, observation["road"].mask)


def test_a_unit_times_a_value_is_the_quantity() -> None:
    """The goal, in the frame of each object, is as far and as fast as in the map."""
    units = {slot.feature: slot.unit for slot in groups_of(OBSERVERS["whole"])["goal"]}
    assert units["cos_yaw"] == units["sin_yaw"] == ""
    length, metres = units["x"].split()
    speed, metres_per_second = units["velocity_x"].split()
    assert (metres, metres_per_second) == ("m", "m/s")
    scene = worlds.scene(worlds.bank("generated"), 0)
    now = worlds.kicked(worlds.log_at(scene, jnp.int32(STEPS[0])), STEPS[0])
    goal = scene.log_end()
    group = seen("whole", "generated")[0]["goal"]
    here = group.mask[:, 0, 0]
    assert here.sum() > 3
    far = np.linalg.norm(np.asarray(goal.xy - now.xy), axis=-1)[here]
    shown = float(length) * np.linalg.norm(group.values[here, 0, 0, :2], axis=-1)
    np.testing.assert_allclose(shown, far, atol=worlds.ROUNDING)
    fast = float(speed) * np.linalg.norm(group.values[here, 0, 0, 4:], axis=-1)
    np.testing.assert_allclose(fast, np.asarray(goal.speed)[here], atol=1e-4)
