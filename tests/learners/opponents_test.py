"""Tests who drives whom: shares as configured, drawn for each episode."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.base import Agent, Output
from drivetrain.agents.distributions import Categorical
from drivetrain.learners import opponents, pasts
from drivetrain.learners.opponents import OpponentsConfig
from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import controlled
from drivetrain.sim.env.base import State, Team
from drivetrain.sim.env.multi_agent import MultiAgentConfig, multi_agent
from drivetrain.sim.env.starts import StartScene
from drivetrain.sim.metrics.displacement import DISPLACEMENT
from drivetrain.sim.observations.vector import VectorConfig, vector
from drivetrain.sim.sim_agents import build as sim_agents
from tests import worlds

SPACE = dynamics.build("delta_discrete")
BLIND = vector(VectorConfig(history=1, num_objects=1, num_road=1, num_lights=0))
CONFIG = OpponentsConfig(myself=0.5, past=0.25, idm=0.125)
WHOLE = controlled.vehicles
NUM_EPISODES = 200
# The mean of 200 draws of yes or no strays by 0.035; this is four times as much.
SAMPLING = 0.14
ROUNDING = 1e-3  # metres; float32 at up to 500 m


def scene(seed: int) -> StartScene:
    bank = worlds.bank("generated")
    key = jax.random.key(seed)
    return StartScene(bank=bank, index=jnp.int32(0), start=jnp.int32(10), key=key)


@functools.cache
def masks() -> np.ndarray:
    """Returns the parts of many episodes, [episodes, parts, objects]."""
    first = np.cumsum([0, CONFIG.myself, CONFIG.past, CONFIG.idm])
    size = [CONFIG.myself, CONFIG.past, CONFIG.idm, 1 - first[-1]]

    @jax.jit
    def parts(key: jax.Array):
        here = scene(0).replace(key=key)
        shares = [
            controlled.share(WHOLE, float(part), float(start))
            for part, start in zip(size, first, strict=True)
        ]
        return jnp.stack([share(here) for share in shares])

    keys = jax.random.split(jax.random.key(0), NUM_EPISODES)
    return np.asarray(jax.vmap(parts)(keys))


def test_parts_share_the_set_out_as_configured() -> None:
    whole = np.asarray(WHOLE(scene(0)))
    count = whole.sum()
    assert count >= 4
    np.testing.assert_array_equal(
        masks().sum(axis=1), np.broadcast_to(whole, (NUM_EPISODES, len(whole)))
    )
    ends = np.ceil(np.array([0.5, 0.75, 0.875, 1.0]) * count)
    expected = np.diff(ends, prepend=0)
    sizes = masks().sum(axis=2)
    np.testing.assert_array_equal(sizes, np.broadcast_to(expected, sizes.shape))


def test_each_object_is_as_likely_in_a_part_and_episodes_differ() -> None:
    whole = np.flatnonzero(WHOLE(scene(0)))
    mine = masks()[:, 0][:, whole]
    often = mine.mean(axis=0)
    np.testing.assert_allclose(often, mine[0].mean(), atol=SAMPLING)
    assert len(np.unique(mine, axis=0)) > 5


def test_a_share_needs_the_start_of_an_episode() -> None:
    with pytest.raises(TypeError, match="as an episode begins"):
        controlled.share(WHOLE, 0.5)(worlds.scene(worlds.bank("generated"), 0))
    with pytest.raises(ValueError, match="within 0 and 1"):
        controlled.share(WHOLE, 0.5, 0.6)


@pytest.mark.parametrize("fields", [{"myself": 0.0}, {"past": 0.5}, {"idm": -0.1}])
def test_parts_that_make_no_whole_are_refused(fields: dict) -> None:
    with pytest.raises(ValueError, match="myself"):
        OpponentsConfig(**fields)


def counting_agent() -> Agent:
    """Builds an agent that acts on what it remembers: how often it has acted."""

    def step(params, memory, observation):
        logits = params * jax.nn.one_hot(memory, 3)
        return memory + 1, Output(
            policy=Categorical(logits=logits), value=jnp.zeros(())
        )

    return Agent(init=lambda key: 1.0, memory=lambda: jnp.int32(0), step=step)


def test_everybody_is_driven_by_whom_the_parts_say() -> None:
    bank, agent = worlds.bank("generated"), counting_agent()
    kept = pasts.begin(jnp.float32(1.0), 2)
    past = opponents.past_self(agent, kept, SPACE, BLIND)
    others = opponents.others(WHOLE, CONFIG, past)
    env = multi_agent(
        (Team(SPACE, opponents.team(WHOLE, CONFIG)),),
        others,
        BLIND,
        lambda moment, number, measures: jnp.float32(0.0),
        (DISPLACEMENT,),
        MultiAgentConfig(),
    )
    state = jax.jit(env.reset)(bank, jnp.int32(0), jax.random.key(3))
    here = scene(0).replace(key=state.key, start=state.step)
    whole = np.asarray(WHOLE(here))
    mine = np.asarray(controlled.share(WHOLE, 0.5)(here))
    past = np.asarray(controlled.share(WHOLE, 0.25, 0.5)(here))
    idm = np.asarray(controlled.share(WHOLE, 0.125, 0.75)(here))
    np.testing.assert_array_equal(state.teams[0], mine)
    assert mine.any() and past.any() and idm.any()

    @jax.jit
    def step(state: State):
        action = jnp.full(len(whole), 7, jnp.int32)
        return env.step(bank, state, (action,))[0]

    idm_agent = sim_agents.build("idm")
    rule = idm_agent.reset(here)
    for number in range(3):
        after = step(state).motion
        there = np.asarray(state.motion.valid)
        logged = here.log_at(state.step + 1)
        by_number = jnp.full(len(whole), number, jnp.int32)
        dt, size = bank.dt, state.object_size
        third = SPACE.forward(state.motion, size, by_number, dt).xy
        seventh = SPACE.forward(state.motion, size, jnp.full_like(by_number, 7), dt).xy
        rule_next = idm_agent.step(here, rule, state.motion, state.step)
        for mask, right in (
            (mine & there, seventh),
            (past & there, third),  # whose memory counts 0, 1, 2
            (idm & there, rule_next[1].xy),
            (~mine & ~past & ~idm & np.asarray(after.valid), logged.xy),
        ):
            np.testing.assert_allclose(
                np.asarray(after.xy)[mask], np.asarray(right)[mask], atol=ROUNDING
            )
        rule = rule_next[0]
        state = step(state)


def test_each_episode_meets_one_past_self() -> None:
    # Of two past selves one finds the first action likeliest, the other the last.
    last = SPACE.action_spec.num_actions - 1
    kept = pasts.keep(pasts.begin(jnp.int32(0), 2), jnp.int32(last), jnp.bool_(True))

    def step(params, memory, observation):
        logits = jax.nn.one_hot(params, SPACE.action_spec.num_actions)
        return memory, Output(policy=Categorical(logits=logits), value=jnp.zeros(()))

    agent = Agent(init=lambda key: jnp.int32(0), memory=lambda: (), step=step)
    past = opponents.past_self(agent, kept, SPACE, BLIND)
    here, num_steps = scene(0), 4

    @jax.jit
    @jax.vmap
    def places(key: jax.Array) -> jax.Array:
        """Tells which of the two acts at each step of an episode."""
        begun = here.replace(key=key)
        motion = begun.log_at(begun.start)
        # Only the first is looked at, which is there.
        both = [
            SPACE.forward(
                motion, begun.object_size, jnp.full(len(motion.yaw), number), 0.1
            ).xy[0]
            for number in (0, last)
        ]

        def step(carry, number):
            carry, moved = past.step(begun, carry, motion, begun.start + number)
            away = [jnp.max(jnp.abs(moved.xy[0] - xy)) for xy in both]
            return carry, jnp.stack(away)

        return jax.lax.scan(step, past.reset(begun), jnp.arange(num_steps))[1]

    away = np.asarray(places(jax.random.split(jax.random.key(0), NUM_EPISODES)))
    acts = away < ROUNDING
    np.testing.assert_array_equal(acts.sum(axis=2), 1)
    np.testing.assert_array_equal(acts, np.repeat(acts[:, :1], num_steps, axis=1))
    assert abs(acts[:, 0, 1].mean() - 0.5) < SAMPLING
