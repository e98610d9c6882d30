"""Measures how many agents can act in a second, over worlds and agents at once."""

import functools
import resource
from collections.abc import Callable, Sequence
from typing import Any

import jax
from jaxtyping import PRNGKeyArray

from ...sim import rewards
from ...sim.data.bank import Bank
from ...sim.dynamics.bicycle import bicycle
from ...sim.env import controlled, drivers
from ...sim.env.base import Driver, Environment, State, Team
from ...sim.env.multi_agent import multi_agent
from ...sim.metrics.collision import COLLISION
from ...sim.metrics.offroad import OFFROAD
from ...sim.observations.base import Observer
from ...sim.scene import Scene
from ...sim.sim_agents import build as sim_agents
from .. import tables
from . import timing
from .base import Benchmark, Cell, Column, Plot, Settings, lines_by, rate, timed
from .scenes import Scenes, mean_valid
from .tasks import starts

NUM_STEPS = 32  # of one call


def play(env: Environment, driver: Driver, *, observes: bool) -> Callable[..., Any]:
    """Returns the function that plays some steps of one world.

    Every step draws actions, moves the objects and measures collision and off-road for
    the reward; where it observes, every object's observation of the state after it is
    written to memory.
    """

    def steps(bank: Bank, state: State, key: PRNGKeyArray) -> Any:
        memory = driver.reset(Scene(bank=bank, index=state.index))

        def step(state, key):
            _, action = driver.act(memory, bank, state, key)
            following, timestep = env.step(bank, state, action)
            seen = env.observe(bank, following) if observes else ()
            return following, (seen, timestep.reward)

        return timing.play(step, state, jax.random.split(key, NUM_STEPS))

    return steps


def measure_cell(
    observer: Observer, settings: Settings, scenes: Scenes, cell: Cell
) -> tables.Row:
    """Returns the figures of a number of worlds, each with a number of object slots."""
    dynamics = bicycle()
    env = multi_agent(
        (Team(dynamics, controlled.everyone),),
        sim_agents.build(settings.sim_agent),
        observer,
        rewards.weighted(rewards.SPARSE),
        (COLLISION, OFFROAD),
    )
    driver = drivers.together(drivers.random(dynamics))
    bank = scenes.bank(cell.objects)
    inputs = starts(env, bank, scenes, cell.batch)
    num_valid = mean_valid(worlds for _, worlds, _ in inputs)
    row: tables.Row = {"valid_objects": num_valid, "compile_s": 0.0}
    for prefix, observes in (("", False), ("observed_", True)):
        steps = play(env, driver, observes=observes)
        program = timing.compile(jax.vmap(steps, in_axes=(None, 0, 0)), inputs[0])
        row["compile_s"] = float(row["compile_s"] or 0) + program.compile_s
        row[f"{prefix}peak_memory_mb"] = program.memory_mb
        if program.memory_mb > settings.max_memory_gb * 1e3:
            continue
        measured = timing.measure(program, inputs, settings.seconds)
        row |= timed(f"{prefix}step_ms", measured, NUM_STEPS)
        agent_steps = cell.batch * num_valid * NUM_STEPS
        row |= rate(f"{prefix}agent_steps_per_s", measured, agent_steps)
    # The most that the process ever took, compiler and all: the cells before count too.
    row["process_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return row


def plots(rows: Sequence[tables.Row]) -> list[Plot]:
    """Returns the step's time and the throughput over worlds, and over agents."""
    figures = {
        "step": ("step_ms", "step [ms]"),
        "observed_step": ("observed_step_ms", "step and observation [ms]"),
        "throughput": ("agent_steps_per_s", "agent-steps/s"),
        "observed_throughput": (
            "observed_agent_steps_per_s",
            "agent-steps/s, observed",
        ),
    }
    return [
        Plot(
            name=f"{name}_over_{x_label}",
            x_label=x_label,
            y_label=y_label,
            lines=lines_by(
                [row for row in rows if key in row],
                lambda row, other=other, unit=unit: f"{unit}: {row[other]}",
                x,
                key,
            ),
        )
        for x, x_label, other, unit in (
            ("batch", "worlds", "objects", "objects each"),
            ("objects", "objects", "batch", "worlds"),
        )
        for name, (key, y_label) in figures.items()
    ]


def throughput(observer: Observer) -> Benchmark:
    """Builds the benchmark of worlds in which every object acts and sees."""
    return Benchmark(
        title="Throughput",
        paper="",
        envs=("multi_agent",),
        batches=(1, 4, 16, 64, 256, 1024),
        objects=(1, 4, 16, 64),
        measure=functools.partial(measure_cell, observer),
        columns=(
            Column(key="step_ms", title="Step", unit="ms"),
            Column(key="observed_step_ms", title="Observed", unit="ms"),
            Column(key="agent_steps_per_s", title="Rate", unit="1000/s", scale=1e-3),
            Column(
                key="observed_agent_steps_per_s",
                title="Observed",
                unit="1000/s",
                scale=1e-3,
            ),
            Column(key="observed_peak_memory_mb", title="Memory", unit="MB"),
        ),
        plots=plots,
        notes=(
            "Rate: steps of objects that are there. A step draws random actions and "
            "measures only collision and off-road; observed, every object looks around "
            "too. What needs more than --max-memory-gb is not run.",
        ),
    )
