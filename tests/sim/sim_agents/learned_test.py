"""Tests sim agents that act: by a policy, by a record, and several in one scene."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.dynamics.bicycle import bicycle
from drivetrain.sim.dynamics.delta import delta
from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.base import View
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.scenario import ObjectType, Scenario
from drivetrain.sim.scene import Scene
from drivetrain.sim.sim_agents.base import SimAgent
from drivetrain.sim.sim_agents.constant_speed import CONSTANT_SPEED
from drivetrain.sim.sim_agents.learned import learned
from drivetrain.sim.sim_agents.mixture import mixture
from drivetrain.sim.sim_agents.playback import PLAYBACK
from drivetrain.sim.sim_agents.recorded import recorded_actions, recorded_motions
from tests import worlds

NUM_STEPS = 30
START = 10  # the current step of generated scenarios
# Sums of 30 displacements, rounded in float32 at up to 500 m.
ROUNDING = 2e-3  # metres


def play(agent: SimAgent, scene: Scene) -> Motion:
    """Lets a sim agent drive everybody; the first row is the log."""
    first = scene.log_at(scene.current_step)

    @jax.jit
    def run(scene: Scene) -> Motion:
        def step(carry, number):
            memory, motion = agent.step(scene, *carry, number)
            return (memory, motion), motion

        steps = scene.current_step + jnp.arange(NUM_STEPS)
        return jax.lax.scan(step, (agent.reset(scene), first), steps)[1]

    return jax.tree.map(
        lambda now, later: jnp.concatenate([now[None], later]), first, run(scene)
    )


@functools.cache
def scene() -> Scene:
    """Returns a scenario with several kinds of objects, one of which comes late."""
    return worlds.scene(worlds.bank_of([worlds.exact(with_a_late_one())] * 3), 2)


def with_a_late_one() -> Scenario:
    """Returns a scenario whose last track joins 15 steps after the current one."""
    scenario = worlds.scenarios("generated")[0]
    valid = scenario.tracks.valid.copy()
    valid[-1, : START + 15] = False
    tracks = dataclasses.replace(scenario.tracks, valid=valid)
    return dataclasses.replace(scenario, tracks=tracks)


def is_vehicle(scene: Scene):
    """Masks the vehicles."""
    return scene.object_type == ObjectType.VEHICLE


def test_a_policy_drives_everybody_who_is_there() -> None:
    # A metre a step along the map's x-axis, by whoever has a positive number.
    def policy(view: View, number):
        del view
        return jnp.where(number > 0, 1.0, 0.0) * jnp.array([1.0, 0.0, 0.0])

    played = play(learned(policy, delta("global")), scene())
    first_steps = []
    for slot in range(1, len(played.yaw[0])):
        here = np.asarray(played.valid)[:, slot]
        if not here.any():
            continue
        joined = int(np.argmax(here))
        first_steps.append(joined)
        assert here[joined:].all()  # also where the log has ended
        moved = np.diff(np.asarray(played.xy)[joined:, slot], axis=0)
        np.testing.assert_allclose(moved, [(1.0, 0.0)] * len(moved), atol=ROUNDING)
    assert len(first_steps) > 5 and 15 in first_steps
    np.testing.assert_allclose(np.diff(played.xy[:, 0], axis=0), 0, atol=ROUNDING)


def test_a_policy_sees_what_happened_and_what_it_did() -> None:
    # Each step is 0.1 m longer than the one before, as the history and the last
    # controls both tell it.
    def policy(view: View, number):
        before = view.motion.xy[-1, number] - view.motion.xy[-2, number]
        held = view.controls[number, :2]
        same = jnp.where(view.step > START, (before + held) / 2, before)
        return jnp.append(same + jnp.array([0.1, 0.0]), 0.0)

    played = play(learned(policy, delta("global"), history=1), scene())
    logged = worlds.log_at(scene(), jnp.int32(START - 1))
    both = np.asarray(logged.valid & played.valid[0])
    first = np.asarray(played.xy[0] - logged.xy)[both]
    moved = np.diff(np.asarray(played.xy), axis=0)[:, both]
    gain = 0.1 * np.arange(1, NUM_STEPS + 1)[:, None, None] * np.array([1.0, 0.0])
    np.testing.assert_allclose(moved, first[None] + gain, atol=ROUNDING)


def test_a_policy_reads_observations_of_its_own_object() -> None:
    observer = vector(VectorConfig(history=1, num_road=4, num_lights=0, goal=True))

    def policy(view: View, number):
        seen = observer.observe(view, number)
        ahead = seen["goal"].values[0, 0, :2]
        return jnp.append(0.2 * jnp.sign(ahead), 0.0)  # in the object's own frame

    agent = learned(policy, delta("local"), history=observer.history)
    played = play(agent, scene())
    ends = scene().log_end()
    start = np.linalg.norm(np.asarray(played.xy[0] - ends.xy), axis=-1)
    far = np.asarray(played.valid[0] & ends.valid) & (start > 12.0)
    end = np.linalg.norm(np.asarray(played.xy[-1] - ends.xy), axis=-1)
    # Steps of 0.2 m ahead and 0.2 m aside, 30 of them, lead at least 6 m nearer.
    assert far.sum() > 2 and np.all(end[far] < start[far] - 6.0 + 0.2 * 2**0.5)


def test_actions_again_are_the_same_motions() -> None:
    def policy(view: View, number):
        push = jnp.sin(1.0 * view.step + number)
        return jnp.stack([3.0 * push, 0.1 * push])

    steps, numbers = np.arange(START + NUM_STEPS), np.arange(worlds.MAX_OBJECTS)
    push = np.sin(1.0 * steps[:, None] + numbers[None])
    actions = np.stack([3.0 * push, 0.1 * push], axis=-1)
    array = jnp.zeros((4, *actions.shape)).at[2].set(jnp.float32(actions))
    done = play(learned(policy, bicycle()), scene())
    again = play(recorded_actions(array, bicycle()), scene())
    np.testing.assert_array_equal(done.valid, again.valid)
    np.testing.assert_allclose(done.xy, again.xy, atol=ROUNDING)


def test_motions_again_are_the_same_motions() -> None:
    done = play(CONSTANT_SPEED, scene())
    index, start = int(scene().index), START

    def whole(leaf):
        rows = jnp.zeros((index + 1, start + NUM_STEPS + 1, *leaf.shape[1:]))
        return rows.astype(leaf.dtype).at[index, start:].set(leaf)

    agent = recorded_motions(jax.tree.map(whole, done))
    again = play(agent, scene())
    jax.tree.map(np.testing.assert_array_equal, done, again)
    last = jax.tree.map(lambda leaf: leaf[-1], done)
    _, after_end = agent.step(scene(), (), last, jnp.int32(NUM_STEPS + START))
    assert np.any(last.valid) and not np.any(after_end.valid)


def test_each_object_of_a_mixture_has_its_own_driver() -> None:
    def nobody(view: View, number):
        del view, number
        return jnp.zeros(3)

    def second(scene: Scene):
        return jnp.arange(len(scene.object_type)) == 1

    parts = (learned(nobody, delta("global")), second), (CONSTANT_SPEED, is_vehicle)
    agent = mixture(parts)
    assert agent.name == "learned+constant_speed"
    played, steady = play(agent, scene()), play(CONSTANT_SPEED, scene())
    logged = play(PLAYBACK, scene())
    vehicles = np.array(is_vehicle(scene()))
    vehicles[1] = False
    others = ~vehicles
    others[1] = False
    assert vehicles.sum() > 2 and np.asarray(logged.valid)[:, others].any()
    for part, source in ((vehicles, steady), (others, logged)):
        for ours, theirs in zip(
            jax.tree.leaves(played), jax.tree.leaves(source), strict=True
        ):
            np.testing.assert_array_equal(ours[:, part], theirs[:, part])
    np.testing.assert_array_equal(played.xy[:, 1], played.xy[:1, 1].repeat(31, axis=0))


@pytest.mark.parametrize("build", [recorded_actions, learned])
def test_a_batch_is_a_loop(build: Callable) -> None:
    bank = worlds.bank("generated")
    actions = jnp.full((6, 91, worlds.MAX_OBJECTS, 2), 0.1)
    given = actions if build is recorded_actions else lambda *_: jnp.full(2, 0.1)
    agent = build(given, bicycle())
    motion = jax.vmap(lambda i: play(agent, Scene(bank=bank, index=i)))(jnp.arange(3))
    alone = play(agent, worlds.scene(bank, 2))
    np.testing.assert_allclose(motion.xy[2], alone.xy, atol=ROUNDING)
