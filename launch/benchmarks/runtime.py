"""Times the environments as W does in its tables 2 and 6.

A figure is the time of one call of one compiled program for a whole batch of worlds:

- reset: the first state of an episode, with what is constant in it;
- transition: the next state, and nothing that it does not need: no metric, no reward;
- metrics: every metric of every object, given the states before and after;
- step: transition, metrics and the reward, W's negative sum of all metrics;
- rollout: reset and 80 steps, in which the expert chooses the action by the inverse
  dynamics; motions, metrics and rewards of all steps are kept;
- observation: what every object sees, which W does not time.

States are those of the expert's episodes, of other scenarios and steps in each call.
The peak memory is that of the rollout, with the bank of the scenarios in it.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from ...sim.data.bank import Bank
from ...sim.env import world
from ...sim.env.base import State
from ...sim.metrics.base import Metric
from ...sim.observations.base import Observation, Observer
from ...sim.observations.vector import VectorConfig, vector
from ...sim.sim_agents import build as sim_agents
from .. import tables
from . import published, timing
from .base import Benchmark, Cell, Column, Plot, Settings, plots_over_objects, timed
from .scenes import Scenes, mean_valid
from .tasks import Task, multi_agent_task, planning_task

ROLLOUT_STEPS = 80  # W 5.1
INPUT_STEPS = (0, 11, 22, 33, 44, 55, 66, 77)  # of the episode; one for each input
TASKS = {"planning": planning_task, "multi_agent": multi_agent_task}


def rollout(task: Task) -> Callable[[Bank, Int[Array, ""], PRNGKeyArray], Any]:
    """Returns the function that plays the expert; past the log steps cost the same."""

    def play(bank: Bank, index: Int[Array, ""], key: PRNGKeyArray) -> Any:
        def step(state, _):
            following, outcome = task.step(bank, state, task.expert(bank, state))
            return following, (following.motion, outcome)

        start = task.reset(bank, index, key)
        return jax.lax.scan(step, start, length=ROLLOUT_STEPS)[1]

    return play


def _inputs(task: Task, bank: Bank, scenes: Scenes, batch: int) -> list[tuple]:
    """Returns batches of index, key, state, the expert's action and the next state."""

    @jax.jit
    @functools.partial(jax.vmap, in_axes=(None, 0, 0, None))
    def play(bank, index, key, num_steps):
        def step(_, state):
            return task.transition(bank, state, task.expert(bank, state))

        state = task.reset(bank, index, key)
        state = jax.lax.fori_loop(0, num_steps, step, state)
        action = task.expert(bank, state)
        return index, key, state, action, task.transition(bank, state, action)

    return [
        play(
            bank,
            scenes.indices(batch, shift),
            jax.random.split(jax.random.key(shift), batch),
            jnp.int32(num_steps),
        )
        for shift, num_steps in enumerate(INPUT_STEPS)
    ]


def observed(observer: Observer) -> Callable[[Bank, State], Observation]:
    """Returns the function by which every object looks around."""

    def observe(bank: Bank, state: State) -> Observation:
        numbers = jnp.arange(len(state.object_size))
        look = jax.vmap(observer.observe, in_axes=(None, 0))
        return look(world.view(bank, state), numbers)

    return observe


def measure_cell(
    metrics: tuple[Metric, ...],
    observer: Observer,
    settings: Settings,
    scenes: Scenes,
    cell: Cell,
) -> tables.Row:
    """Returns the figures of an environment, a batch and a number of object slots."""
    task = TASKS[cell.env](metrics, sim_agents.build(settings.sim_agent))
    bank = scenes.bank(cell.objects)
    inputs = _inputs(task, bank, scenes, cell.batch)
    begins = [(index, key) for index, key, *_ in inputs]
    moves = [(state, action) for _, _, state, action, _ in inputs]
    pairs = [(state, following) for _, _, state, _, following in inputs]
    states = [(state,) for _, _, state, *_ in inputs]
    programs = {
        "reset_ms": (task.reset, begins),
        "transition_ms": (task.transition, moves),
        "metrics_ms": (task.metrics, pairs),
        "step_ms": (task.step, moves),
        "rollout_ms": (rollout(task), begins),
        "observation_ms": (observed(observer), states),
    }
    row: tables.Row = {"valid_objects": mean_valid(state for state, _ in moves)}
    compile_s = 0.0
    for key, (function, chosen) in programs.items():
        arguments = [(bank, *pair) for pair in chosen]
        batched = jax.vmap(function, in_axes=(None, *(0 for _ in chosen[0])))
        program = timing.compile(batched, arguments[0])
        row |= timed(key, timing.measure(program, arguments, settings.seconds))
        compile_s += program.compile_s
        if key == "rollout_ms":
            row["peak_memory_mb"] = program.memory_mb
    row["compile_s"] = compile_s
    platform = jax.default_backend()
    figures = published.waymax(cell.env, platform, cell.batch, cell.objects)
    return row | {f"{key}_published": figure for key, figure in figures.items()}


def plots(rows: Sequence[tables.Row]) -> list[Plot]:
    """Returns step, rollout and memory over the number of objects (W figures 4, 5)."""
    return plots_over_objects(
        rows,
        (
            ("step", "step_ms", "step [ms]"),
            ("rollout", "rollout_ms", "80-step rollout [ms]"),
            ("observation", "observation_ms", "observation [ms]"),
            ("memory", "peak_memory_mb", "peak memory [MB]"),
        ),
    )


def runtime(metrics: tuple[Metric, ...], sight: VectorConfig) -> Benchmark:
    """Builds the benchmark of steps that measure some metrics.

    Args:
        metrics: what is measured.
        sight: what objects see; without history, which the states do not have.
    """
    return Benchmark(
        title="Runtime",
        paper="W",
        envs=tuple(TASKS),
        batches=(1, 16),
        objects=(8, 16, 32, 64, 128),
        measure=functools.partial(measure_cell, metrics, vector(sight)),
        columns=(
            Column(key="reset_ms", title="Reset", unit="ms"),
            Column(key="transition_ms", title="Transition", unit="ms"),
            Column(key="metrics_ms", title="Metrics", unit="ms"),
            Column(key="step_ms", title="Step", unit="ms"),
            Column(key="rollout_ms", title="Rollout", unit="ms"),
            Column(key="observation_ms", title="Observe", unit="ms", is_extra=True),
            Column(key="peak_memory_mb", title="Memory", unit="MB"),
        ),
        plots=plots,
        notes=(
            f"Observe: what all objects see, each {sight.num_road:,} {sight.road} of "
            "the road.",
            "W: Waymax with as many objects and worlds on the same kind of device: of "
            "128 objects its table 2 (Xeon W-2135 or V100), of fewer, and of the "
            "memory, its table 6 (EPYC 7B12 or V100).",
        ),
    )
