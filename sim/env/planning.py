"""Plays a scenario with the ego under control (W 4.3)."""

from collections.abc import Collection, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from .. import motions
from ..data.bank import Bank
from ..dynamics.base import Action, Dynamics
from ..metrics.base import Metric, is_any_positive
from ..metrics.build import EGO, METRICS, measure_ego
from ..observations.base import Observation, Observer
from ..rewards import Reward
from ..scene import Scene
from ..sim_agents.base import SimAgent
from . import controlled, world
from .base import Environment, State, Team, Timestep
from .starts import AS_LOGGED, StartConfig


def planning(
    dynamics: Dynamics,
    sim_agent: SimAgent,
    observer: Observer,
    reward: Reward,
    metrics: Sequence[Metric] = METRICS,
    starts: StartConfig = AS_LOGGED,
    settled_at: Collection[str] = (),
) -> Environment:
    """Builds the environment.

    Args:
        dynamics: of the ego.
        sim_agent: drives all others.
        observer: what the ego sees.
        reward: of the state after the action.
        metrics: what is measured of the ego.
        starts: how episodes begin.
        settled_at: metrics that settle what came before where they are positive: what
            follows has a discount of 0, though the episode goes on.
    """
    teams = (Team(dynamics, controlled.ego),)

    def reset(bank: Bank, index: Int[Array, ""], key: PRNGKeyArray) -> State:
        return world.begin(bank, index, key, teams, sim_agent, observer.history, starts)

    def step(bank: Bank, state: State, action: Action) -> tuple[State, Timestep]:
        scene = Scene(bank=bank, index=state.index)
        carry, others = sim_agent.step(scene, state.sim_agent, state.motion, state.step)
        before, size = motions.object_of(state.motion, EGO), state.object_size[EGO]
        ego = dynamics.forward(before, size, action, bank.dt)
        moved = jax.tree.map(lambda all_, one: all_.at[EGO].set(one), others, ego)
        moment = world.moment(scene, state, moved, scene.log_at(state.step + 1))
        measures = measure_ego(moment, metrics)
        controls = state.controls.at[EGO].set(dynamics.controls(action))
        following = world.follow(state, moment.after, carry, controls)
        timestep = Timestep(
            acted=before.valid,
            reward=reward(moment, jnp.int32(EGO), measures),
            discount=1.0 - is_any_positive(measures, settled_at).astype(jnp.float32),
            terminated=jnp.bool_(False),
            truncated=following.step + 1 >= scene.num_steps,
            measures=measures,
        )
        return following, timestep

    def observe(bank: Bank, state: State) -> Observation:
        return observer.observe(world.view(bank, state), jnp.int32(EGO))

    return Environment(dynamics.action_spec, reset, step, observe)
