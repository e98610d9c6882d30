"""Plays a scenario with any of its objects under control (W 4.3; N 3.2).

An action is a tuple: of each team one action per object of the scenario. Actions of
objects that a team does not control, or that are not there, change nothing. Where few
of many objects act, `max_actors` has only those few observed.

A controlled object stays from its first valid step to the end of the log, or until it
is removed: then it is neither seen nor hit any more. The step that removes it still
gives its reward and its measures. Others may be removed as those who act are, such as
past selves whom they meet.
"""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .. import motions, names
from ..data.bank import Bank
from ..metrics.base import Measure, Metric, Moment, is_any_positive, only
from ..metrics.build import EGO, METRICS, measure_all
from ..motion import Motion
from ..observations.base import Observation, Observer
from ..rewards import Reward
from ..scene import Scene
from ..sim_agents.base import Carry, SimAgent
from . import controlled, world
from .base import Act, Controls, Environment, State, Team, Timestep
from .starts import AS_LOGGED, StartConfig, StartScene


@dataclasses.dataclass(frozen=True, kw_only=True)
class MultiAgentConfig:
    """Who takes part, and until when."""

    remove_at: tuple[str, ...] = ()  # metrics that end a part where positive
    joins_later: bool = True  # whether objects appear after the start, as in the log
    max_actors: int | None = None  # the first ones are controlled; None: all
    starts: StartConfig = AS_LOGGED


def multi_agent(
    teams: Sequence[Team],
    sim_agent: SimAgent,
    observer: Observer,
    reward: Reward,
    metrics: Sequence[Metric] = METRICS,
    config: MultiAgentConfig = MultiAgentConfig(),
    rivals: Controls = controlled.nobody,
) -> Environment:
    """Builds the environment.

    Args:
        teams: who is controlled, and by which dynamics; an object that several claim
            belongs to the first.
        sim_agent: drives all others.
        observer: what each actor sees.
        reward: of each object, of the state after the action.
        metrics: what is measured of each object.
        config: who takes part, and until when.
        rivals: whose part ends as that of the teams', whoever drives them.

    Raises:
        ValueError: if there is no team, or objects are to be removed at a metric that
            is not measured.
    """
    _check(teams, metrics, config)

    def reset(bank: Bank, index: Int[Array, ""], key: PRNGKeyArray) -> State:
        state = world.begin(
            bank,
            index,
            key,
            teams,
            sim_agent,
            observer.history,
            config.starts,
            config.max_actors,
        )
        late = state.admitted if config.joins_later else state.motion.valid
        scene = StartScene(bank=bank, index=index, start=state.step, key=state.key)
        return state.replace(admitted=late, removable=state.removable | rivals(scene))

    def step(bank: Bank, state: State, actions: Act) -> tuple[State, Timestep]:
        moment, carry, controls = _advance(teams, sim_agent, bank, state, actions)
        there = state.motion.valid
        acted = state.controlled & there
        measures = _measure(moment, metrics)
        ends = is_any_positive(measures, config.remove_at)
        admitted = state.admitted & ~(ends & state.removable & there)
        measures = only(measures, acted)
        motion = motions.only(admitted, moment.after)
        following = world.follow(state, motion, carry, controls)
        goes_on = state.controlled & admitted
        timestep = Timestep(
            acted=acted,
            reward=_reward(reward, moment, measures, acted),
            discount=goes_on.astype(jnp.float32),
            terminated=~goes_on,
            truncated=following.step + 1 >= moment.scene.num_steps,
            measures=measures,
        )
        return following.replace(admitted=admitted), timestep

    def observe(bank: Bank, state: State) -> Observation:
        numbers = controlled.actors(config.max_actors, state)
        numbers = jnp.minimum(numbers, len(state.admitted) - 1)  # where a seat is empty
        observe = jax.vmap(observer.observe, in_axes=(None, 0))
        return observe(world.view(bank, state), numbers)

    spec = tuple(team.dynamics.action_spec for team in teams)
    return Environment(spec, reset, step, observe, config.max_actors)


def _check(
    teams: Sequence[Team], metrics: Sequence[Metric], config: MultiAgentConfig
) -> None:
    if not teams:
        raise ValueError("multi_agent needs at least one team, got none.")
    measured = [metric.name for metric in metrics]
    for name in config.remove_at:
        if name not in measured:
            raise names.unknown("metric in remove_at", name, measured)


def _advance(
    teams: Sequence[Team], sim_agent: SimAgent, bank: Bank, state: State, actions: Act
) -> tuple[Moment, Carry, Float[Array, "objects features"]]:
    """Moves everybody who is admitted; a controlled object joins where its log does."""
    scene = Scene(bank=bank, index=state.index)
    logged = scene.log_at(state.step + 1)
    carry, others = sim_agent.step(scene, state.sim_agent, state.motion, state.step)
    others = motions.where(state.controlled, logged, others)
    moved, controls = _move(teams, bank, state, actions, others)
    moved = motions.only(state.admitted, moved)
    return world.moment(scene, state, moved, logged), carry, controls


def _move(
    teams: Sequence[Team],
    bank: Bank,
    state: State,
    actions: Act,
    others: Motion,
) -> tuple[Motion, Float[Array, "objects features"]]:
    """Moves the controlled objects that are there, and notes their controls."""
    motion, controls = others, state.controls
    for team, mask, action in zip(teams, state.teams, actions, strict=True):
        acts = mask & state.motion.valid
        # An action that changes nothing may be NaN, and would spoil the gradient.
        used = acts.reshape(-1, *[1] * (action.ndim - 1))
        action = jnp.where(used, action, jnp.zeros_like(action))
        moved = team.dynamics.forward(state.motion, state.object_size, action, bank.dt)
        motion = motions.where(acts, moved, motion)
        chosen = world.pad(team.dynamics.controls(action), controls.shape[-1])
        controls = jnp.where(acts[:, None], chosen, controls)
    return motion, controls


def _measure(moment: Moment, metrics: Sequence[Metric]) -> dict[str, Measure]:
    """Measures each object; what needs the ego's paths, of the ego alone."""
    shape = moment.after.valid.shape
    is_ego = jnp.arange(shape[0]) == EGO
    measures = measure_all(moment, metrics)
    for metric in metrics:
        measure = measures[metric.name]
        valid = is_ego & measure.valid if metric.ego_only else measure.valid
        measures[metric.name] = Measure(
            value=jnp.broadcast_to(measure.value, shape),
            valid=jnp.broadcast_to(valid, shape),
        )
    return measures


def _reward(
    reward: Reward,
    moment: Moment,
    measures: dict[str, Measure],
    acted: Bool[Array, " objects"],
) -> Float[Array, " objects"]:
    numbers = jnp.arange(len(acted))
    of_each = jax.vmap(reward, in_axes=(None, 0, 0))(moment, numbers, measures)
    return jnp.where(acted, of_each, 0.0)
