"""Times steps with Nocturne's observation, by both procedures of N appendix F.

- single_agent: at each step one random vehicle is observed and moved by a random
  action, while all others replay the log (or follow --sim-agent);
- multi_agent: at each step all vehicles that agents may control are observed and moved
  by random actions, while all others do likewise.

Each step looks whether any object hits another or a road edge. Episodes begin at the
current step of the log; theirs begin at its first step.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from ...sim import rewards
from ...sim.data.bank import Bank
from ...sim.dynamics import build as dynamics
from ...sim.env import controlled, drivers, world
from ...sim.env.base import Driver, Environment, State, Team
from ...sim.env.multi_agent import multi_agent
from ...sim.metrics.collision import COLLISION
from ...sim.metrics.edge_contact import EDGE_CONTACT
from ...sim.observations.base import Observation, Observer, View
from ...sim.scenario import ObjectType
from ...sim.scene import Scene
from ...sim.sim_agents import build as sim_agents
from .. import tables
from . import published, timing
from .base import (
    Benchmark,
    Cell,
    Column,
    Plot,
    Settings,
    plots_over_objects,
    rate,
    timed,
)
from .scenes import Scenes, mean_valid
from .tasks import starts

NUM_STEPS = 80  # of an episode

# Of a state and a key: the state with its team, the numbers of agents, and who of them
# looks around.
Choice = tuple[State, Int[Array, " agents"], Bool[Array, " agents"]]
Choose = Callable[[Bank, State, PRNGKeyArray], Choice]


def random_vehicle(bank: Bank, state: State, key: PRNGKeyArray) -> Choice:
    """Gives one random vehicle that is there to the team."""
    scene = Scene(bank=bank, index=state.index)
    there = state.motion.valid & (scene.object_type == ObjectType.VEHICLE)
    number = jax.random.categorical(key, jnp.where(there, 0.0, -jnp.inf))
    team = jnp.arange(len(there)) == number
    return state.replace(teams=(team,)), number[None], there[number][None]


def all_controlled(num_agents: int) -> Choose:
    """Builds the choice of the whole team, which has at most so many members."""

    def choose(bank: Bank, state: State, key: PRNGKeyArray) -> Choice:
        del bank, key
        members = jnp.argsort(~state.controlled, stable=True)[:num_agents]
        return state, members, state.controlled[members]

    return choose


def episode(
    env: Environment, driver: Driver, observer: Observer, choose: Choose
) -> Callable[..., Any]:
    """Returns the function that plays one scenario."""

    def look(view: View, number: Int[Array, ""], looks: Bool[Array, ""]) -> Observation:
        # Who is not there sees nothing, at no cost; nobody's own box matters to him.
        valid = view.motion.valid
        valid = valid.at[:, number].set(valid[:, number] & looks)
        motion = view.motion.replace(valid=valid)
        return observer.observe(view.replace(motion=motion), number)

    def play(bank: Bank, state: State, key: PRNGKeyArray) -> Any:
        memory = driver.reset(Scene(bank=bank, index=state.index))

        def step(state, key):
            choice_key, action_key = jax.random.split(key)
            state, numbers, looks = choose(bank, state, choice_key)
            observe = jax.vmap(functools.partial(look, world.view(bank, state)))
            observation = observe(numbers, looks)
            _, action = driver.act(memory, bank, state, action_key)
            following, timestep = env.step(bank, state, action)
            return following, (observation, timestep.measures)

        return timing.play(step, state, jax.random.split(key, NUM_STEPS))

    return play


def measure_cell(
    observer: Observer, settings: Settings, scenes: Scenes, cell: Cell
) -> tables.Row:
    """Returns the figures of a procedure, a batch and a number of object slots."""
    space = dynamics.build("kinematic_bicycle_head")
    movers = controlled.moving_vehicles(
        controlled.MovingConfig(max_objects=cell.objects)
    )
    env = multi_agent(
        (Team(space, movers),),
        sim_agents.build(settings.sim_agent),
        observer,
        rewards.weighted({COLLISION.name: -1.0}),
        (COLLISION, EDGE_CONTACT),
    )
    bank = scenes.bank(cell.objects)
    inputs = starts(env, bank, scenes, cell.batch)
    choose, num_agents = random_vehicle, 1.0
    if cell.env == "multi_agent":
        counts = jnp.stack([states.teams[0].sum(axis=-1) for _, states, _ in inputs])
        choose, num_agents = all_controlled(int(counts.max())), float(counts.mean())
    play = episode(env, drivers.together(drivers.random(space)), observer, choose)
    program = timing.compile(jax.vmap(play, in_axes=(None, 0, 0)), inputs[0])
    measured = timing.measure(program, inputs, settings.seconds)
    row: tables.Row = {
        "valid_objects": mean_valid(states for _, states, _ in inputs),
        "agents": num_agents,
        "compile_s": program.compile_s,
        "peak_memory_mb": program.memory_mb,
    }
    row |= timed("step_ms", measured, NUM_STEPS)
    num_steps = NUM_STEPS * cell.batch * num_agents
    row |= rate("agent_steps_per_s", measured, num_steps)
    figure = published.nocturne(cell.env, float(row["valid_objects"] or 0))
    return row if figure is None else row | {"agent_steps_per_s_published": figure}


def plots(rows: Sequence[tables.Row]) -> list[Plot]:
    """Returns the rate over the objects of a scene, as N figure 7 does."""
    return plots_over_objects(
        rows,
        (
            ("step", "step_ms", "step and observation [ms]"),
            ("rate", "agent_steps_per_s", "agent-steps/s"),
        ),
    )


def nocturne_speed(observer: Observer) -> Benchmark:
    """Builds the benchmark of steps in which agents see what an observer shows."""
    return Benchmark(
        title="Steps with Nocturne's observation",
        paper="N",
        envs=("single_agent", "multi_agent"),
        batches=(1,),
        objects=(11, 21, 31, 64, 128),
        measure=functools.partial(measure_cell, observer),
        columns=(
            Column(key="agents", title="Agents", unit=""),
            Column(key="step_ms", title="Step", unit="ms"),
            Column(key="agent_steps_per_s", title="Rate", unit="1/s"),
            Column(key="peak_memory_mb", title="Memory", unit="MB"),
        ),
        plots=plots,
        notes=(
            "Rate: steps of agents, with an observation each.",
            "N: Nocturne, appendix F, where about as many objects are there: one agent "
            "among 10, 20 or 30 other vehicles. Of several agents it has one figure, "
            "for 8.5 on average.",
        ),
    )
