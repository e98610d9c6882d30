"""Runs a benchmark: measures its cells, shows the table and writes it down."""

import dataclasses
import functools
import importlib.resources
import io
import os
import pathlib
import platform

import jax
from rich import console as rich_console

from ..sim.metrics.build import METRICS
from ..sim.observations.compact import CompactConfig, compact
from ..sim.observations.nocturne import NocturneConfig, nocturne
from ..sim.observations.vector import VectorConfig
from ..sim.sim_agents import build as sim_agents
from . import config, report, tables
from .benchmarks import page, scenes, table
from .benchmarks.base import Benchmark, Settings
from .benchmarks.nocturne_speed import nocturne_speed
from .benchmarks.runtime import runtime
from .benchmarks.throughput import throughput
from .benchmarks.training import training
from .experiment import Experiment
from .progress import progress

# The road as published simulators show it, and little else.
ROAD = VectorConfig(
    history=0, num_objects=1, road="points", num_road=1000, num_lights=0, num_route=0
)
# What a learner is timed on, and the field that says how many worlds it plays at once.
LEARNERS = {
    "bc": ("small_bc", "learner.batch_size"),
    "dqn": ("small_dqn", "learner.num_worlds"),
    "ppo": ("small_ppo", "learner.num_worlds"),
    "self_play": ("small_self_play", "learner.num_worlds"),
    "apg": ("small_apg", "learner.num_worlds"),
}


def _experiment_of(name: str, num_worlds: int) -> Experiment:
    file, field = LEARNERS[name]
    words = [f"{field}={num_worlds}", "seeds=1", "monitor=null"]
    words.append("learner.decay_updates=null")  # counts the steps of another number
    if name == "dqn":
        words.append("learner.min_replay=1")  # it learns from the first update on
    packaged = importlib.resources.files("drivetrain.configs") / f"{file}.yaml"
    with importlib.resources.as_file(packaged) as path:
        return config.load(path, Experiment, words)


BENCHMARKS = {
    "runtime": runtime(METRICS, ROAD),
    "nocturne": nocturne_speed(nocturne(NocturneConfig())),
    "throughput": throughput(compact(CompactConfig())),
    "training": training(
        {name: functools.partial(_experiment_of, name) for name in LEARNERS}, 64
    ),
}
REPORT_COLUMNS = 120  # characters of a line of the report


def benchmark(
    name: str,
    settings: Settings,
    json: pathlib.Path | None,
    folder: pathlib.Path | None,
) -> None:
    """Measures a table and prints it.

    Args:
        name: one of `BENCHMARKS`.
        settings: what to measure, and on what.
        json: where to write the rows; not at all if None.
        folder: where to write table and plots as a report; not at all if None.

    Raises:
        FileNotFoundError: if there are no such data.
        ValueError: if the data hold no usable scenario, or a name is unknown.
    """
    chosen = BENCHMARKS[name]
    sim_agents.build(settings.sim_agent)
    loaded = scenes.load(settings.data, settings.scenarios)
    facts = {
        "device": device(),
        "jax": jax.__version__,
        "data": f"{len(loaded.scenarios)} scenarios of {settings.data}",
        "sim_agent": settings.sim_agent,
    }
    cells = chosen.cells(settings)
    rows: list[tables.Row] = []
    with progress(f"measuring {name}", len(cells), unit="rows") as line:
        for cell in cells:
            line.update(len(rows), f"{cell.env}, {cell.batch} x {cell.objects}")
            figures = chosen.measure(settings, loaded, cell)
            rows.append({**facts, **dataclasses.asdict(cell), **figures})
        line.update(len(rows))
    compile_s = sum(float(row["compile_s"] or 0) for row in rows)
    facts["compiled"] = f"in {compile_s:.0f} s, which no figure contains"

    _print(rich_console.Console(), chosen, rows, facts)
    if json is not None:
        tables.write_json(json, rows)
    if folder is not None:
        page_text = io.StringIO()
        console = rich_console.Console(file=page_text, width=REPORT_COLUMNS)
        _print(console, chosen, rows, facts)
        page.write(
            folder,
            title=f"Drivetrain: {chosen.title}",
            table=page_text.getvalue(),
            plots=chosen.plots(rows),
            facts=report.environment() | facts,
        )


def _print(
    console: rich_console.Console,
    chosen: Benchmark,
    rows: list[tables.Row],
    facts: dict[str, str],
) -> None:
    console.print(table.terminal(chosen, rows, facts, console.width))


def device() -> str:
    """Returns the name of the device that computes."""
    kind = jax.devices()[0].device_kind
    cpus = pathlib.Path("/proc/cpuinfo")
    if kind != "cpu" or not cpus.exists():
        return kind
    lines = cpus.read_text().splitlines()
    models = [line.partition(":")[2] for line in lines if line.startswith("model name")]
    model = models[0].strip() if models else platform.machine()
    return f"{model}, {os.cpu_count()} cores"
