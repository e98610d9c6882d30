"""Tests of the multi-agent task: who moves, who is there, and what each gets."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import rewards
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import controlled, drivers
from drivetrain.sim.env.base import Environment, State, Team, Timestep
from drivetrain.sim.env.multi_agent import MultiAgentConfig, multi_agent
from drivetrain.sim.env.rollout import Rollout, has_ended, rollout
from drivetrain.sim.metrics import aggregate
from drivetrain.sim.metrics.build import METRICS
from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.records import Record
from drivetrain.sim.scenario import ObjectType
from drivetrain.sim.sim_agents import build as sim_agents
from drivetrain.sim.sim_agents.base import SimAgent
from drivetrain.sim.sim_agents.playback import PLAYBACK
from tests import worlds

BUSY = 0  # a generated scenario with all kinds of objects, of whom some join late
LATE = 13  # a vehicle of it that is not there at the start
NUM_OBJECTS = 15  # slots of the bank
NUM_STEPS = 25
MEASURED = ("collision", "offroad", "kinematic", "log_displacement", "progress")
CHEAP = tuple(metric for metric in METRICS if metric.name in MEASURED)
SMALL = VectorConfig(history=2, num_objects=3, num_road=4, num_lights=2, num_route=3)
# One program in another order of vectorisation: rounding errors of places up to 300 m,
# added up over the steps [m and m/s].
DRIFT = 3e-3
IDM = sim_agents.build("idm")
ALL_CARS = (Team(dynamics.build("bicycle"), controlled.everyone),)

RIDERS = controlled.of_type(ObjectType.PEDESTRIAN, ObjectType.CYCLIST)
LATECOMER = Team(
    dynamics.build("bicycle"),
    lambda scene: scene.object_mask & (jnp.arange(NUM_OBJECTS) == LATE),
)


class Step(Record):
    """What a step leaves behind."""

    state: State
    timestep: Timestep


def env_of(
    teams: tuple[Team, ...] = ALL_CARS, sim_agent: SimAgent = PLAYBACK, **config: Any
) -> Environment:
    return multi_agent(
        teams,
        sim_agent,
        vector(SMALL),
        rewards.weighted(rewards.SPARSE),
        CHEAP,
        MultiAgentConfig(**config),
    )


def played(env: Environment, bank: Bank, index: int, actions: Any) -> Step:
    """Plays actions with a leading axis of steps."""

    @jax.jit
    def play(bank, actions):
        def step(state, action):
            state, timestep = env.step(bank, state, action)
            return state, Step(state=state.replace(key=()), timestep=timestep)

        state = env.reset(bank, jnp.int32(index), jax.random.key(0))
        return jax.lax.scan(step, state, actions)[1]

    return jax.device_get(play(bank, actions))


@functools.cache
def wild(num_objects: int = NUM_OBJECTS) -> jax.Array:
    """Returns random accelerations and curvatures of objects over some steps."""
    rng = np.random.default_rng(0)
    bounds = np.array([6.0, 0.3])
    drawn = rng.uniform(-bounds, bounds, (NUM_STEPS, num_objects, 2))
    return jnp.asarray(drawn, jnp.float32)


@functools.cache
def log_of(index: int) -> Motion:
    """Returns the log of the steps that `played` simulates."""
    scene = worlds.scene(worlds.bank("generated"), index)
    return jax.device_get(jax.vmap(scene.log_at)(11 + jnp.arange(NUM_STEPS)))


def assert_equal(a: Any, b: Any, tolerance: float = 0.0) -> None:
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(np.float64(x), np.float64(y), atol=tolerance)


def test_others_follow_the_log_whatever_the_controlled_do() -> None:
    bank = worlds.bank("generated")
    env = env_of((Team(dynamics.build("bicycle"), controlled.vehicles),))
    motion = played(env, bank, BUSY, (wild(),)).state.motion
    is_car = np.asarray(controlled.vehicles(worlds.scene(bank, BUSY)))
    others = jax.tree.map(lambda leaf: leaf[:, ~is_car], (motion, log_of(BUSY)))
    assert others[0].valid.any() and is_car.any()
    assert_equal(*others)
    cars = jax.tree.map(lambda leaf: leaf[-1, is_car], (motion, log_of(BUSY)))
    there = cars[0].valid & cars[1].valid
    assert np.all(np.abs(cars[0].xyz - cars[1].xyz)[there].max(axis=-1) > 0.01)


def test_what_nobody_may_do_changes_nothing() -> None:
    bank = worlds.bank("generated")
    env = env_of((Team(dynamics.build("bicycle"), controlled.vehicles),))
    calm = played(env, bank, BUSY, (wild(),))
    actions = jnp.where(calm.timestep.acted[..., None], wild(), jnp.nan)
    assert_equal(played(env, bank, BUSY, (actions,)), calm)


def test_who_does_not_act_gets_no_reward() -> None:
    bank, cars = worlds.bank("generated"), controlled.vehicles
    team = Team(dynamics.build("bicycle"), cars)
    env = multi_agent((team,), PLAYBACK, vector(SMALL), lambda *_: jnp.float32(1.0), ())
    timestep = played(env, bank, BUSY, (wild(),)).timestep
    is_car = np.asarray(cars(worlds.scene(bank, BUSY)))
    np.testing.assert_array_equal(timestep.reward > 0, timestep.acted)
    np.testing.assert_array_equal(timestep.acted.any(axis=0), is_car)


@pytest.mark.parametrize("max_actors", [3, NUM_OBJECTS - 1])
def test_the_first_of_the_controlled_have_the_seats(max_actors: int) -> None:
    bank, team = worlds.bank("generated"), Team(dynamics.build("bicycle"), RIDERS)
    env = env_of((team,), max_actors=max_actors)
    every = env_of((team,))
    state = env.reset(bank, jnp.int32(BUSY), jax.random.key(0))
    whole = every.reset(bank, jnp.int32(BUSY), jax.random.key(0))
    (wanted,) = np.nonzero(whole.teams[0])
    assert len(wanted) in range(4, NUM_OBJECTS - 1)
    taken = wanted[:max_actors]
    np.testing.assert_array_equal(np.flatnonzero(state.teams[0]), taken)

    numbers = controlled.actors(max_actors, state)
    empty = np.full(max_actors - len(taken), NUM_OBJECTS)
    np.testing.assert_array_equal(numbers, [*taken, *empty])
    seen, all_seen = env.observe(bank, state), every.observe(bank, whole)
    of_seats = (
        jax.tree.map(lambda leaf: leaf[: len(taken)], seen),
        jax.tree.map(lambda leaf: leaf[taken], all_seen),
    )
    assert_equal(*of_seats)
    np.testing.assert_array_equal(
        controlled.actors(None, whole), np.arange(NUM_OBJECTS)
    )


def test_the_gradient_survives_actions_that_change_nothing() -> None:
    team = Team(dynamics.build("kinematic_bicycle"), controlled.ego)
    env, bank = env_of((team,)), worlds.bank("generated")
    state = env.reset(bank, jnp.int32(0), jax.random.key(0))

    def reach(actions):
        return jnp.sum(env.step(bank, state, (actions,))[0].motion.xyz)

    actions = jnp.full((NUM_OBJECTS, 2), jnp.nan).at[0].set(0.5)
    gradient = jax.jit(jax.grad(reach))(actions)
    assert jnp.all(jnp.isfinite(gradient)) and gradient[0, 0] != 0


def test_each_team_moves_its_own_objects_by_its_own_dynamics() -> None:
    bank = worlds.bank("generated")
    bicycle, delta = dynamics.build("bicycle"), dynamics.build("delta_global")
    teams = (
        Team(delta, controlled.of_type(ObjectType.PEDESTRIAN, ObjectType.CYCLIST)),
        Team(bicycle, controlled.everyone),
    )
    env = env_of(teams)
    assert env.action_spec == (delta.action_spec, bicycle.action_spec)
    stride = jnp.broadcast_to(jnp.array([0.3, -0.1, 0.0]), (NUM_STEPS, NUM_OBJECTS, 3))
    braking = jnp.broadcast_to(jnp.array([-1.0, 0.0]), (NUM_STEPS, NUM_OBJECTS, 2))
    state = played(env, bank, BUSY, (stride, braking)).state
    scene = worlds.scene(bank, BUSY)
    start = worlds.log_at(scene, scene.current_step)
    walks = np.asarray(start.valid & (scene.object_type > ObjectType.VEHICLE))
    drives = np.asarray(start.valid & (scene.object_type == ObjectType.VEHICLE))
    assert walks.sum() > 2 and drives.sum() > 2

    way = state.motion.xyz[-1, :, :2] - start.xy
    walked = np.broadcast_to(NUM_STEPS * np.array([0.3, -0.1]), way.shape)
    np.testing.assert_allclose(way[walks], walked[walks], atol=DRIFT)
    slower = start.speed - np.linalg.norm(state.motion.velocity[4], axis=-1)
    fast = drives & (np.asarray(start.speed) > 1)
    np.testing.assert_allclose(slower[fast], 0.5, atol=DRIFT)
    np.testing.assert_array_equal(state.controls[-1, walks], stride[0, walks])
    np.testing.assert_array_equal(state.controls[-1, drives, 2], 0)


NOBODY = SimAgent(
    "nobody",
    lambda scene: (),
    lambda scene, carry, motion, step: (carry, jax.tree.map(jnp.zeros_like, motion)),
)


def test_a_controlled_object_that_is_late_joins_as_in_the_log() -> None:
    env = env_of((LATECOMER,), NOBODY)
    out, log = played(env, worlds.bank("generated"), BUSY, (wild(),)), log_of(BUSY)
    motion, numbers = out.state.motion, np.arange(NUM_STEPS)
    first = int(np.argmax(log.valid[:, LATE]))
    assert 0 < first < NUM_STEPS - 1
    np.testing.assert_array_equal(motion.valid[:, LATE], numbers >= first)
    np.testing.assert_array_equal(motion.xyz[first, LATE], log.xyz[first, LATE])
    np.testing.assert_array_equal(out.timestep.acted[:, LATE], numbers > first)
    assert not out.timestep.terminated[:, LATE].any()


def test_who_is_late_never_joins_where_that_is_off() -> None:
    bank = worlds.bank("generated")
    env = env_of((LATECOMER,), joins_later=False)
    out = played(env, bank, BUSY, (wild(),))
    here = worlds.log_at(worlds.scene(bank, BUSY), jnp.int32(10)).valid
    expected = log_of(BUSY).valid & np.asarray(here)[None]
    np.testing.assert_array_equal(out.state.motion.valid, expected)
    assert out.timestep.terminated[:, LATE].all()


def test_a_controlled_object_stays_when_its_log_ends() -> None:
    bank = worlds.bank("generated")
    actions = jnp.zeros((80, NUM_OBJECTS, 2))
    there = played(env_of(), bank, BUSY, (actions,)).state.motion.valid
    scene = worlds.scene(bank, BUSY)
    here, gone = (worlds.log_at(scene, jnp.int32(step)).valid for step in (10, 90))
    left = np.asarray(here & ~gone)
    assert left.any() and there[:, left].all()


def leaping(removes: bool) -> Step:
    """Lets the ego leap off the road, and another vehicle after it."""
    bank = worlds.bank("generated")
    team = Team(dynamics.build("delta_global"), controlled.vehicles)
    env = env_of((team,), remove_at=("offroad",) if removes else ())
    start = worlds.log_at(worlds.scene(bank, BUSY), jnp.int32(10))
    far = jnp.array([900.0, 900.0])
    actions = jnp.zeros((3, NUM_OBJECTS, 3))
    actions = actions.at[0, 0, :2].set(far - start.xy[0])
    actions = actions.at[1, 1, :2].set(far - start.xy[1])
    return played(env, bank, BUSY, (actions,))


def test_who_is_removed_gets_the_last_reward_and_is_gone() -> None:
    out = leaping(removes=True)
    np.testing.assert_array_equal(out.timestep.reward[:, 0], [-1, 0, 0])
    np.testing.assert_array_equal(out.timestep.acted[:, 0], [True, False, False])
    np.testing.assert_array_equal(out.timestep.terminated[:, 0], [True] * 3)
    np.testing.assert_array_equal(out.timestep.discount[:, 1], [1, 0, 0])
    assert not any(leaf[:, 0].any() for leaf in jax.tree.leaves(out.state.motion))
    assert not out.timestep.truncated.any()


@pytest.mark.parametrize("removes", [True, False])
def test_nobody_collides_with_the_removed(removes: bool) -> None:
    collision = leaping(removes).timestep.measures["collision"]
    assert collision.valid[1, 1]
    assert bool(collision.value[1, 1]) is not removes


def test_rivals_are_removed_as_those_who_act_are() -> None:
    bank, space = worlds.bank("generated"), dynamics.build("delta_global")
    ego_acts = (Team(space, controlled.ego),)

    def leap(scene, carry, motion, step):
        return carry, motion.replace(xyz=motion.xyz.at[1:3, :2].set(900.0))

    leaper = SimAgent("leaper", lambda scene: (), leap)

    def first(scene):
        return jnp.arange(len(scene.object_mask)) == 1

    env = multi_agent(
        ego_acts,
        leaper,
        vector(SMALL),
        rewards.weighted(rewards.SPARSE),
        CHEAP,
        MultiAgentConfig(remove_at=("offroad",)),
        rivals=first,
    )
    out = played(env, bank, BUSY, (jnp.zeros((2, NUM_OBJECTS, 3)),))
    valid = out.state.motion.valid
    # Two are moved off the road: the rival alone is gone, the ego alone is told of.
    np.testing.assert_array_equal(valid[:, 1:3], [[False, True], [False, True]])
    assert not out.timestep.acted[:, 1:].any()
    assert not any(m.valid[:, 1:].any() for m in out.timestep.measures.values())
    assert out.timestep.measures["offroad"].valid[:, 0].all()


def test_an_episode_without_anybody_left_has_ended() -> None:
    bank = worlds.bank("generated")
    team = Team(dynamics.build("delta_global"), controlled.ego)
    env = env_of((team,), remove_at=("offroad",))
    state = env.reset(bank, jnp.int32(BUSY), jax.random.key(0))
    for leap, ends in ((0.0, False), (900.0, True)):
        _, timestep = jax.jit(env.step)(
            bank, state, (jnp.full((NUM_OBJECTS, 3), leap),)
        )
        assert bool(has_ended(timestep)) is ends


@functools.cache
def expert() -> Rollout:
    """Returns an episode that the expert drives, pedestrians apart from vehicles."""
    space = dynamics.build("delta")
    env = env_of(
        (Team(space, controlled.vehicles), Team(space, controlled.pedestrians))
    )
    driver = drivers.together(*[drivers.build_all("expert", space)] * 2)
    bank = worlds.bank("generated")
    play = jax.jit(
        lambda: rollout(env, driver, bank, jnp.int32(BUSY), jax.random.key(0))
    )
    return jax.device_get(play())


def test_the_expert_of_each_object_repeats_its_log() -> None:
    displacement = expert().measures["log_displacement"]
    assert displacement.valid.any(axis=0).sum() > 8
    assert displacement.value[displacement.valid].max() < DRIFT


def test_episodes_are_summarized_per_controlled_object() -> None:
    measures = expert().measures
    episodes = jax.vmap(aggregate.summarize, in_axes=1)(
        {m.name: measures.get(m.name, measures["progress"]) for m in METRICS}
    )
    for name in ("collision", "kinematic"):
        flagged = (measures[name].value > 0) & measures[name].valid
        np.testing.assert_array_equal(episodes.value[name], flagged.any(axis=0))
    scene = worlds.scene(worlds.bank("generated"), BUSY)
    kinds = (ObjectType.VEHICLE, ObjectType.PEDESTRIAN)
    chosen = np.isin(scene.object_type, kinds)
    np.testing.assert_array_equal(episodes.valid["collision"], chosen)
    np.testing.assert_array_equal(
        episodes.valid["progress"], np.arange(NUM_OBJECTS) == 0
    )


def test_observations_are_those_of_each_object() -> None:
    env, bank = env_of(), worlds.bank("generated")
    state = env.reset(bank, jnp.int32(BUSY), jax.random.key(0))
    seen = jax.jit(env.observe)(bank, state)["ego"]
    np.testing.assert_array_equal(seen.mask[:, 0, -1], state.motion.valid)
    # Each sees itself in the origin of its frame: at (0, 0), along (1, 0).
    pose = seen.values[:, 0, -1, :4][np.asarray(state.motion.valid)]
    np.testing.assert_allclose(pose, np.tile([0, 0, 1, 0], (len(pose), 1)), atol=1e-6)


def test_removal_at_what_is_not_measured_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'colision'; did you mean 'collision'\?"):
        env_of(remove_at=("colision",))


def test_a_task_needs_a_team() -> None:
    with pytest.raises(ValueError, match="at least one team, got none"):
        env_of(())
