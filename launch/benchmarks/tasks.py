"""Puts the expert of the log at the wheel of the environments that are timed."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import jax
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from ...sim import rewards
from ...sim.data.bank import Bank
from ...sim.dynamics.bicycle import bicycle
from ...sim.env import controlled, drivers
from ...sim.env.base import Act, Driver, Environment, State, Team
from ...sim.env.multi_agent import multi_agent
from ...sim.env.planning import planning
from ...sim.metrics.base import Measure, Metric, Moment
from ...sim.metrics.build import measure_all
from ...sim.observations.base import Observer
from ...sim.rewards import Reward
from ...sim.scene import Scene
from ...sim.sim_agents.base import SimAgent
from .scenes import Scenes

Measures = dict[str, Measure]
Outcome = tuple[Measures, Float[Array, "*objects"]]  # and the reward
Step = Callable[[Bank, State, Act], tuple[State, Outcome]]

NUM_INPUTS = 4  # batches of worlds that take turns
BLIND = Observer(history=0, observe=lambda view, number: {}, describe=lambda: ())


@dataclasses.dataclass(frozen=True, kw_only=True)
class Task:
    """What is timed of one world."""

    reset: Callable[[Bank, Int[Array, ""], PRNGKeyArray], State]
    expert: Callable[[Bank, State], Act]  # the action
    transition: Callable[[Bank, State, Act], State]
    metrics: Callable[[Bank, State, State], Measures]  # of all objects
    step: Step  # with these metrics


def starts(
    env: Environment, bank: Bank, scenes: Scenes, batch: int
) -> list[tuple[Bank, State, Key[Array, " worlds"]]]:
    """Returns the bank with worlds at their start and a key for each, some times."""
    reset = jax.jit(jax.vmap(env.reset, in_axes=(None, 0, 0)))
    inputs = []
    for shift in range(NUM_INPUTS):
        keys = jax.random.split(jax.random.key(shift), batch)
        inputs.append((bank, reset(bank, scenes.indices(batch, shift), keys), keys))
    return inputs


def measure(
    metrics: Sequence[Metric], bank: Bank, before: State, after: State
) -> Measures:
    """Returns metrics of all objects, those of the route of the ego alone."""
    scene = Scene(bank=bank, index=after.index)
    return measure_all(
        Moment(
            scene=scene,
            object_size=after.object_size,
            step=after.step,
            before=before.motion,
            after=after.motion,
            logged=scene.log_at(after.step),
            goal=after.goal,
        ),
        metrics,
    )


def reward_of(metrics: Sequence[Metric]) -> Reward:
    """Builds the negative sum of metrics (W 5.1)."""
    return rewards.weighted({metric.name: -1.0 for metric in metrics})


def planning_task(metrics: tuple[Metric, ...], sim_agent: SimAgent) -> Task:
    """Builds the task in which the ego acts.

    The environment itself measures the ego alone, which is all that its reward needs;
    W measures every object, and so does the step that is timed.
    """
    dynamics = bicycle()
    env = planning(dynamics, sim_agent, BLIND, reward_of(metrics), metrics)

    def step(bank: Bank, state: State, action: Act) -> tuple[State, Outcome]:
        following, timestep = env.step(bank, state, action)
        measures = measure(metrics, bank, state, following)
        return following, (measures, timestep.reward)

    return _task(env, drivers.build("expert", dynamics), metrics, step)


def multi_agent_task(metrics: tuple[Metric, ...], sim_agent: SimAgent) -> Task:
    """Builds the task in which every object acts, as a bicycle."""
    dynamics = bicycle()
    team = Team(dynamics, controlled.everyone)
    env = multi_agent((team,), sim_agent, BLIND, reward_of(metrics), metrics)
    driver = drivers.together(drivers.build_all("expert", dynamics))

    def step(bank: Bank, state: State, action: Act) -> tuple[State, Outcome]:
        following, timestep = env.step(bank, state, action)
        return following, (timestep.measures, timestep.reward)

    return _task(env, driver, metrics, step)


def _task(
    env: Environment, driver: Driver, metrics: tuple[Metric, ...], step: Step
) -> Task:
    def expert(bank: Bank, state: State) -> Act:
        # Its memory is empty: playback asks the log alone.
        memory = driver.reset(Scene(bank=bank, index=state.index))
        return driver.act(memory, bank, state, state.key)[1]

    def transition(bank: Bank, state: State, action: Act) -> State:
        return env.step(bank, state, action)[0]

    return Task(
        reset=env.reset,
        expert=expert,
        transition=transition,
        metrics=functools.partial(measure, metrics),
        step=step,
    )
