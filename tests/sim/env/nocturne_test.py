"""Tests the multi-agent task against rollouts of the published Nocturne.

The oracle (see the README beside its files) holds the states, rewards and flags of four
episodes of its environment, two of the log's expert and two of random actions.
"""

import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from drivetrain.sim import rewards
from drivetrain.sim.data.bank import Bank
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import controlled
from drivetrain.sim.env.base import Team, Timestep
from drivetrain.sim.env.multi_agent import MultiAgentConfig, multi_agent
from drivetrain.sim.metrics.collision import COLLISION
from drivetrain.sim.metrics.edge_contact import edge_contact
from drivetrain.sim.metrics.goal import GOAL
from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.records import Record
from drivetrain.sim.sim_agents.playback import PLAYBACK
from tests import nocturne, worlds

EPISODES = [
    (scene, policy) for scene in nocturne.SCENES for policy in ("expert", "random")
]
BLIND = vector(VectorConfig(history=0, num_objects=1, num_road=1, num_lights=0))

# At 9 km from its origin Nocturne's float32 rounds each of 80 steps by 0.5 mm at most;
# the errors are random, so that they add up to sqrt(80) of one [m].
DRIFT = 0.5e-3 * math.sqrt(80)
TURN_DRIFT = 80 * 1.2e-7  # radians: half a unit of the last place of 3, 80 times
SPEED_DRIFT = 80 * 5e-7  # metres per second, likewise of 10
REWARD_ROUNDING = 1e-6


class Episode(Record):
    """What happened in an episode of ours to the objects that Nocturne controls."""

    motion: Motion  # after each step
    timestep: Timestep


@functools.cache
def program(scene: str, space: str) -> Callable[[Float[Array, "80 n f"]], Episode]:
    """Compiles an episode of given actions; all that is not controlled plays back."""
    bank = worlds.bank_of([worlds.exact(nocturne.scenario(scene))], max_objects=64)
    env = multi_agent(
        (Team(dynamics.build(space), controlled.moving_vehicles()),),
        PLAYBACK,
        BLIND,
        rewards.nocturne_dense(),
        (COLLISION, edge_contact(math.inf), GOAL),
        MultiAgentConfig(remove_at=("goal", "collision", "edge_contact")),
    )

    @jax.jit
    def play(bank: Bank, actions: Float[Array, "80 n f"]) -> Episode:
        def step(state, action):
            state, timestep = env.step(bank, state, (action,))
            return state, Episode(motion=state.motion, timestep=timestep)

        state = env.reset(bank, jnp.int32(0), jax.random.key(0))
        return jax.lax.scan(step, state, actions)[1]

    return functools.partial(play, bank)


def played(
    scene: str, space: str, ids: np.ndarray, action: Float[np.ndarray, "80 n f"]
) -> Episode:
    """Plays the actions of some vehicles and returns what happens to these."""
    object_id = worlds.exact(nocturne.scenario(scene)).object_id
    rows = np.array([np.flatnonzero(object_id == number)[0] for number in ids])
    # Nobody else may act, so that nobody else's actions may matter.
    actions = np.full((80, len(object_id), action.shape[-1]), np.nan, np.float32)
    actions[:, rows] = action
    episode = program(scene, space)(jnp.asarray(actions))
    return jax.tree.map(
        lambda leaf: leaf[:, rows] if leaf.ndim > 1 else leaf[:, None],
        jax.device_get(episode),
    )


@functools.cache
def driven(scene: str, policy: str) -> tuple[dict[str, np.ndarray], Episode]:
    """Returns the oracle, and ours from the same actions."""
    oracle = nocturne.oracle(f"env_{scene}_{policy}_0")
    action = oracle["action"][..., :2]
    return oracle, played(scene, "kinematic_bicycle", oracle["ids"], action)


def assert_same_flags(oracle: dict[str, np.ndarray], timestep: Timestep) -> None:
    """Asserts that who acts, reaches the goal, collides and ends is the same."""
    acted = oracle["done"] != -1
    np.testing.assert_array_equal(timestep.acted, acted)
    ended = timestep.terminated | timestep.truncated
    np.testing.assert_array_equal(ended[acted], oracle["done"][acted] == 1)
    goal, collided, vehicle, edge = np.moveaxis(oracle["info"][acted], -1, 0)
    measured = {name: m.value[acted] for name, m in timestep.measures.items()}
    np.testing.assert_array_equal(measured["goal"], goal)
    hit = np.maximum(measured["collision"], measured["edge_contact"])
    np.testing.assert_array_equal(hit, collided)
    np.testing.assert_array_equal(measured["edge_contact"], edge)
    # Where a vehicle hits both, Nocturne names the edge alone.
    np.testing.assert_array_equal(measured["collision"] * (1 - edge), vehicle)


@pytest.mark.parametrize("scene", nocturne.SCENES)
def test_the_same_vehicles_are_controlled(scene: str) -> None:
    bank = worlds.bank_of([worlds.exact(nocturne.scenario(scene))], max_objects=64)
    mask = jax.jit(controlled.moving_vehicles())(worlds.scene(bank, 0))
    names = worlds.exact(nocturne.scenario(scene)).object_id[np.asarray(mask)]
    assert sorted(names) == sorted(nocturne.oracle(f"env_{scene}_expert_0")["ids"])


@pytest.mark.parametrize(("scene", "policy"), EPISODES)
def test_the_same_actions_lead_to_the_same_states(scene: str, policy: str) -> None:
    oracle, episode = driven(scene, policy)
    there, state = episode.motion.valid, oracle["state"][1:]
    goes_on = (oracle["done"] != -1) & ~(oracle["info"][..., :2] == 1).any(-1)
    np.testing.assert_array_equal(there, goes_on)
    xy = episode.motion.xyz[..., :2] + nocturne.scenario(scene).origin[:2]
    turn = episode.motion.yaw - state[..., 2]
    forward = np.stack([np.cos(state[..., 2]), np.sin(state[..., 2])], axis=-1)
    speed = np.sum(episode.motion.velocity * forward, axis=-1)
    assert np.abs(xy - state[..., :2])[there].max() < DRIFT
    assert np.abs((turn + np.pi) % (2 * np.pi) - np.pi)[there].max() < TURN_DRIFT
    assert np.abs(speed - state[..., 3])[there].max() < SPEED_DRIFT


@pytest.mark.parametrize(("scene", "policy"), EPISODES)
def test_the_same_actions_lead_to_the_same_flags(scene: str, policy: str) -> None:
    oracle, episode = driven(scene, policy)
    assert_same_flags(oracle, episode.timestep)


@pytest.mark.parametrize(("scene", "policy"), EPISODES)
def test_the_same_states_give_the_same_rewards_and_flags(
    scene: str, policy: str
) -> None:
    oracle = nocturne.oracle(f"env_{scene}_{policy}_0")
    after = np.float64(oracle["state"][1:])
    xy, yaw, speed = np.split(after, (2, 3), axis=-1)
    pose = [xy - nocturne.scenario(scene).origin[:2], yaw, speed * np.cos(yaw)]
    action = np.concatenate([*pose, speed * np.sin(yaw)], axis=-1)
    timestep = played(scene, "pose", oracle["ids"], action).timestep
    assert_same_flags(oracle, timestep)
    acted = oracle["done"] != -1
    difference = (timestep.reward - oracle["reward"])[acted]
    assert np.abs(difference).max() < REWARD_ROUNDING
    assert not timestep.reward[~acted].any()
