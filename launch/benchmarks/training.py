"""Measures an iteration of each learner, and what acting and learning cost apart."""

import dataclasses
import functools
import statistics
import time
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp

from ...learners import mesh as meshes
from ...learners.program import compile_halves, compile_program, initial_state
from ...sim.data import bank as banks, dealing
from .. import tables
from ..banks import one_shard
from ..experiment import Experiment, agent, environment, keys, learner
from .base import Benchmark, Cell, Column, Plot, Settings
from .scenes import Scenes, mean_valid

UPDATES = 4  # of one call
MIN_ROUNDS = 5  # in each of which every program is called once

# An experiment with so many worlds at once, or demonstrations.
ExperimentOf = Callable[[int], Experiment]


def measure_cell(
    experiments: Mapping[str, ExperimentOf],
    settings: Settings,
    scenes: Scenes,
    cell: Cell,
) -> tables.Row:
    """Returns the figures of a learner.

    The programs are called in turn, so that what disturbs the machine for a while
    disturbs all of them.
    """
    experiment, mesh = experiments[cell.env](cell.batch), meshes.data_mesh()
    task = dataclasses.replace(experiment.task, sim_agent=settings.sim_agent)
    experiment = dataclasses.replace(experiment, task=task)
    sizes = banks.Sizes.of(scenes.scenarios, cell.objects)
    count, num_strata = len(scenes.scenarios), experiment.learner.strata
    dealt = dealing.by_stratum(count, mesh.size, num_strata)
    bank = meshes.shard(mesh, dealing.build_shards(scenes.scenarios, sizes, dealt))
    env = environment(experiment)
    learns = learner(experiment, env, agent(experiment, env, one_shard(bank)))
    state = initial_state(learns, mesh, keys(experiment), bank)

    began = time.perf_counter()
    iterate = compile_program(learns, mesh, UPDATES)
    act, learn = compile_halves(learns, mesh, UPDATES)
    state, _ = iterate(state, bank)
    acted, experience = act(jax.tree.map(jnp.copy, state), bank)
    learned = learn(jax.tree.map(jnp.copy, acted), bank, experience)
    jax.block_until_ready((acted, learned))
    compile_s = time.perf_counter() - began

    # Each goes on from a state of its own, which it may write over, as in training.
    programs = {
        "iteration_ms": (state, lambda state: iterate(state, bank)[0]),
        "acting_ms": (acted, lambda state: act(state, bank)[0]),
        "update_ms": (learned, lambda state: learn(state, bank, experience)),
    }
    times: dict[str, list[float]] = {name: [] for name in programs}
    spent = 0.0
    while len(times["acting_ms"]) < MIN_ROUNDS or spent < settings.seconds:
        for name, (state, call) in programs.items():
            began = time.perf_counter()
            state = jax.block_until_ready(call(state))
            duration = time.perf_counter() - began
            programs[name] = (state, call)
            times[name].append(1e3 * duration / UPDATES)
            spent += duration

    row: tables.Row = {"learner": cell.env, "compile_s": compile_s}
    for name, durations in times.items():
        quarters = statistics.quantiles(durations, n=4, method="inclusive")
        row |= {f"{name}_q1": quarters[0], name: quarters[1], f"{name}_q3": quarters[2]}
    acting, update, whole = (
        float(row[name] or 0) for name in ("acting_ms", "update_ms", "iteration_ms")
    )
    row["ratio"] = whole / (acting + update)
    row["acting_share"] = acting / (acting + update)
    row["steps_per_second"] = experiment.learner.num_steps / whole * 1e3
    reset = jax.vmap(env.reset, in_axes=(None, 0, None))
    local = jax.tree.map(lambda leaf: leaf[0], bank)
    numbers = jnp.arange(len(dealt[0]))
    row["valid_objects"] = mean_valid([reset(local, numbers, jax.random.key(0))])
    return row


def plots(rows: Sequence[tables.Row]) -> list[Plot]:
    """Returns the rate of each learner over its worlds."""
    lines: dict[str, tuple[list[float], list[float]]] = {}
    for row in rows:
        batches, rates = lines.setdefault(str(row["learner"]), ([], []))
        batches.append(float(row["batch"] or 0))
        rates.append(float(row["steps_per_second"] or 0))
    return [Plot(name="steps", x_label="worlds", y_label="steps/s", lines=lines)]


def training(experiments: Mapping[str, ExperimentOf], batch: int) -> Benchmark:
    """Builds the benchmark of learners.

    Args:
        experiments: by the name of the learner.
        batch: worlds at once, the usual number.
    """
    return Benchmark(
        title="Training",
        paper="",
        envs=tuple(experiments),
        batches=(batch,),
        objects=(16,),
        measure=functools.partial(measure_cell, experiments),
        columns=(
            Column(key="acting_ms", title="Acting", unit="ms"),
            Column(key="update_ms", title="Update", unit="ms"),
            Column(key="iteration_ms", title="Both fused", unit="ms"),
            Column(key="ratio", title="Fused/apart", unit=""),
            Column(key="acting_share", title="Acting", unit="%", scale=100.0),
            Column(key="steps_per_second", title="Rate", unit="1000/s", scale=1e-3),
        ),
        plots=plots,
        notes=(
            "Rate: steps of worlds, of bc demonstrations, in a second of training. "
            "Acting and update are measured apart; apg acts as it learns.",
        ),
    )
