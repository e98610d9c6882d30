"""Tests of Nocturne's observation: its layout, and what must not matter to it."""

import dataclasses
import functools
import math
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.base import Observation
from drivetrain.sim.observations.nocturne import (
    IMITATION,
    LIGHT_STATES,
    NocturneConfig,
    flat,
    nocturne,
)
from drivetrain.sim.scene import Scene
from tests import worlds

FULL = NocturneConfig(ego_features=10, num_lights=20)
STEP = 30
# Positions up to 300 m in float32, turned (1e-4 m), and their angles from 1 m away.
ROUNDING = 3e-4
ANGLES = {"ego": (4, 5), "objects": (2, 5, 6), "stop_signs": (2,)}


def generated(index: int = 1) -> tuple[Scene, Motion]:
    scene = worlds.scene(worlds.bank("generated"), index)
    return scene, worlds.log_at(scene, jnp.int32(STEP))


@functools.partial(jax.jit, static_argnums=3)
def observed(
    scene: Scene,
    motion: Motion,
    number,
    config: NocturneConfig = FULL,
    tilt=0.0,
    step=STEP,
) -> Observation:
    controls = jnp.zeros((len(motion.yaw), 3)).at[number, 2].set(tilt)
    frame = jax.tree.map(lambda leaf: leaf[None], motion)
    view = worlds.view_of(scene, frame, 0).replace(step=step, controls=controls)
    return nocturne(config).observe(view, number)


def test_vectors_have_the_published_sizes() -> None:
    scene, motion = generated()
    for config, size in ((NocturneConfig(), 6727), (FULL, 6970)):
        seen = jax.eval_shape(lambda c=config: observed(scene, motion, 0, c))
        assert jax.eval_shape(flat, seen).shape == (size,)
        widths = {name: group.values.shape[-1] for name, group in seen.items()}
        assert Counter(slot.group for slot in nocturne(config).describe()) == widths


def test_groups_follow_each_other_in_the_published_order() -> None:
    seen = observed(*generated(), 0)
    order = ("ego", "objects", "road", "lights", "stop_signs")
    expected = np.concatenate([seen[name].values.ravel() for name in order])
    np.testing.assert_array_equal(flat(seen), expected)


def test_turning_and_shifting_the_map_changes_nothing() -> None:
    scenario = worlds.scenarios("generated")[1]
    turned = worlds.turned(scenario, 1.1, np.array([500.0, -300.0, 20.0]))
    other = worlds.scene(worlds.bank_of([worlds.exact(turned)]), 0)
    scene, motion = generated()
    for number in np.flatnonzero(motion.valid)[:4]:
        before = observed(scene, motion, number)
        after = observed(other, worlds.log_at(other, jnp.int32(STEP)), number)
        for name, group in before.items():
            np.testing.assert_array_equal(after[name].mask, group.mask)
        # Points equally far, such as those of crossing lanes, may change places.
        for name in ("ego", "objects", "stop_signs"):
            change = np.array(after[name].values - before[name].values)
            turn = change[..., ANGLES[name]]
            change[..., ANGLES[name]] = (turn + np.pi) % (2 * np.pi) - np.pi
            np.testing.assert_allclose(change, 0, atol=ROUNDING)
        far = [np.asarray(seen["road"].values[:, 0, 1]) for seen in (before, after)]
        np.testing.assert_allclose(*far, atol=ROUNDING)


def test_permuting_objects_changes_nothing_but_their_numbers() -> None:
    scene, motion = generated()
    order = np.random.default_rng(0).permutation(int(scene.object_mask.sum()))
    bank, first = scene.bank, int(scene.bank.first_object[scene.index])
    rows = np.arange(len(bank.object_type))
    rows[first : first + len(order)] = first + order
    columns = ("object_type", "object_size", "valid_bits", "is_still", "first_row")
    shuffled = {name: getattr(bank, name)[rows] for name in columns}
    other = scene.replace(bank=bank.replace(**shuffled))
    for number in np.flatnonzero(motion.valid)[:4]:
        there = int(np.flatnonzero(order == number)[0])
        before = observed(scene, motion, number)
        after = observed(other, worlds.log_at(other, jnp.int32(STEP)), there)
        np.testing.assert_array_equal(flat(after), flat(before))


def test_a_hidden_object_leaves_no_trace() -> None:
    scene, motion = generated()
    viewer, wall, hidden = 0, 1, 2
    ahead = np.array([np.cos(motion.yaw[viewer]), np.sin(motion.yaw[viewer])])
    xy = np.asarray(motion.xy[viewer])
    xyz = motion.xyz.at[wall, :2].set(xy + 5.0 * ahead)
    xyz = xyz.at[hidden, :2].set(xy + 12.0 * ahead)
    yaw = motion.yaw.at[wall].set(motion.yaw[viewer] + np.pi / 2)
    valid = jnp.zeros_like(motion.valid).at[jnp.array([viewer, wall, hidden])].set(True)
    size = scene.bank.object_size.at[scene.bank.first_object[scene.index] + wall, 0]
    scene = scene.replace(bank=scene.bank.replace(object_size=size.set(10.0)))
    crowd = motion.replace(xyz=xyz, yaw=yaw, valid=valid)
    assert int(observed(scene, crowd, viewer)["objects"].mask.sum()) == 1
    without = crowd.replace(valid=valid.at[hidden].set(False))
    np.testing.assert_array_equal(
        flat(observed(scene, crowd, viewer)), flat(observed(scene, without, viewer))
    )
    bare = without.replace(valid=without.valid.at[wall].set(False))
    shown = [observed(scene, m, viewer)["road"].mask.sum() for m in (without, bare)]
    assert shown[0] < shown[1]


def test_tilting_the_head_turns_the_cone_alone() -> None:
    scene, motion = generated()
    config = dataclasses.replace(FULL, view_angle=1.0)
    tilted = observed(scene, motion, 0, config, jnp.float32(1.0))
    wide = observed(scene, motion, 0, dataclasses.replace(FULL, view_angle=3.0))
    assert float(tilted["ego"].values[0, 0, 9]) == 1.0
    shown = np.asarray(tilted["road"].values[tilted["road"].mask])
    assert len(shown) > 10
    assert (np.abs(shown[:, 2] - 1.0) <= 0.5 + ROUNDING).all()
    rows = set(map(tuple, np.asarray(wide["road"].values[wide["road"].mask])))
    near = shown[: len(shown) // 4]  # the wide cone holds more, so it ends sooner
    assert set(map(tuple, near)) <= rows


def test_frames_of_the_imitation_variant_are_observations_of_past_steps() -> None:
    """At the end of the log, so that a later frame would lack lights."""
    scene, _ = generated()
    config = dataclasses.replace(
        IMITATION, num_lights=20, view_angle=2 * math.pi, view_distance=300.0
    )
    last = int(scene.num_steps) - 1
    steps = jnp.arange(last - config.history, last + 1)
    motions = jax.vmap(scene.log_at)(steps)
    view = worlds.view_of(scene, motions, last)
    stacked = jax.jit(nocturne(config).observe)(view, jnp.int32(0))
    assert stacked["lights"].mask.any(axis=0).all()
    alone = dataclasses.replace(config, history=0)
    frames = [
        flat(observed(scene, worlds.log_at(scene, step), 0, alone, step=step))
        for step in steps
    ]
    np.testing.assert_allclose(flat(stacked), np.concatenate(frames), atol=ROUNDING)


def test_an_object_that_is_not_there_sees_nothing() -> None:
    scene, motion = generated()
    gone = motion.replace(valid=motion.valid.at[0].set(False))
    for group in observed(scene, gone, 0).values():
        assert not group.values.any() and not group.mask.any()


def test_lights_show_their_state_in_the_order_of_nocturne() -> None:
    config = dataclasses.replace(FULL, view_angle=2 * math.pi, view_distance=300.0)
    count = 0
    for index in range(len(worlds.SEEDS)):
        scene, motion = generated(index)
        lights = scene.lights_at(jnp.int32(STEP))
        offset = np.asarray(lights.xyz[:, :2] - motion.xy[:1])
        distance = np.linalg.norm(offset, axis=1)
        there = np.flatnonzero(np.asarray(lights.valid) & (distance <= 300.0))
        there = there[np.argsort(distance[there], kind="stable")][:20]
        group = observed(scene, motion, 0, config)["lights"]
        shown = np.asarray(group.values[: len(there), 0])
        np.testing.assert_allclose(shown[:, 1], distance[there], atol=ROUNDING)
        states = [LIGHT_STATES.index(int(lights.state[i])) for i in there]
        np.testing.assert_array_equal(shown[:, 3:].argmax(axis=1), states)
        np.testing.assert_array_equal(shown[:, 3:].sum(axis=1), 1)
        count += len(there)
    assert count > 5


def test_gradients_are_finite_and_tell_how_features_change() -> None:
    scene, motion = generated()
    config = dataclasses.replace(FULL, view_angle=2 * math.pi)

    def features(xyz):
        seen = observed(scene, motion.replace(xyz=xyz), 0, config)
        return seen["objects"].values[0, 0, 1], flat(seen).sum()

    assert features(motion.xyz)[0] > 0
    for total in jax.jacobian(features)(motion.xyz):
        assert jnp.isfinite(total).all()
    to_nearest, _ = jax.jacobian(features)(motion.xyz)
    np.testing.assert_allclose(jnp.linalg.norm(to_nearest[0]), 1.0, rtol=1e-5)
    np.testing.assert_allclose(to_nearest.sum(axis=0), 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("view_angle", 0.0),
        ("view_angle", 7.0),
        ("view_distance", math.inf),
        ("num_objects", 0),
        ("num_lights", -1),
    ],
)
def test_a_config_out_of_range_says_which_field_it_is(field: str, value) -> None:
    with pytest.raises(ValueError, match=rf"^{field} must .*, got {value}\.$"):
        NocturneConfig(**{field: value})


def test_ten_features_of_past_egos_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^ego_features must be 7 with a history"):
        dataclasses.replace(IMITATION, ego_features=10)
