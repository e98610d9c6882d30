"""Runs the commands: `drivetrain prepare | data | train | evaluate …`."""

import dataclasses
import os
import pathlib
import shlex
import sys
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import jax
import tyro
from rich import console as rich_console

from ..learners import mesh as meshes
from ..sim import files
from ..sim.data import loader
from ..sim.data.loader import Split
from ..sim.data.query import EVERYTHING, Query
from ..sim.dynamics.build import DYNAMICS
from ..sim.sim_agents.build import SIM_AGENTS
from . import (
    actions as recording,
    banks,
    benchmark as benchmarking,
    config,
    curves as drawing,
    demo as demos,
    dump as dumps,
    evaluate as evaluating,
    outputs,
    spelling,
    stores,
    tables,
)
from .benchmarks import timing
from .benchmarks.base import Settings, numbers
from .experiment import Experiment
from .progress import progress
from .train import train as run_training

Dynamics = Annotated[str, tyro.conf.arg(metavar="|".join(DYNAMICS))]
SimAgent = Annotated[str, tyro.conf.arg(metavar="|".join(SIM_AGENTS))]
UNSEEN = "synthetic:2000000:256"  # generated scenarios that nothing trains on


def train(
    config_file: Annotated[
        pathlib.Path, tyro.conf.Positional, tyro.conf.arg(metavar="CONFIG")
    ],
    fields: Annotated[
        tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[FIELD=VALUE …]")
    ] = (),
    /,
    out: pathlib.Path | None = None,
    debug_nans: bool = False,
) -> None:
    """Trains an agent as a config says.

    drivetrain train configs/bc.yaml data=data/womd learner.learning_rate=3e-5

    The same command continues a run that was cut.

    Args:
        config_file: a YAML file; see configs/.
        fields: any of its fields, as field=value.
        out: the folder of the run; by default runs/ and the name of the config.
        debug_nans: stop at the first operation whose result is no number, and show it;
            slow.
    """
    jax.config.update("jax_debug_nans", debug_nans)
    experiment = config.load(config_file, Experiment, fields)
    folder = out or pathlib.Path("runs") / config_file.stem
    _warn_of_pages(experiment)
    run_training(experiment, folder)
    print(f"trained: {folder}; evaluate it with: {_evaluation(experiment, folder)}")


def _warn_of_pages(experiment: Experiment) -> None:
    stream, updates = experiment.stream, experiment.updates
    if stream.resident is not None and stream.updates_per_page > updates:
        print(
            f"drivetrain: no page will be exchanged: stream.updates_per_page "
            f"({stream.updates_per_page:,}) is more than updates ({updates:,})",
            file=sys.stderr,
        )


def _evaluation(experiment: Experiment, folder: pathlib.Path) -> str:
    """Returns the command that plays what a run has not trained on."""
    words = ["drivetrain", "evaluate", str(folder)]
    if experiment.split == "train":
        words += ["--data", experiment.data, "--split", "test"]
        if experiment.test_share != loader.Source.test_share:
            words += ["--test-share", str(experiment.test_share)]
    return shlex.join(words)


def evaluate(
    agent: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="AGENT")],
    /,
    data: str = UNSEEN,
    split: Split = "all",
    test_share: float = 1 / 3,
    query: Query = EVERYTHING,
    sim_agent: SimAgent = "playback",
    dynamics: Dynamics | None = None,
    max_objects: int = 128,
    max_scenarios: int | None = None,
    quantize: bool = True,
    json: pathlib.Path | None = None,
    dump: pathlib.Path | None = None,
    record: pathlib.Path | None = None,
    actions: pathlib.Path | None = None,
    run_seed: int | None = None,
    seed: int = 0,
) -> None:
    """Plays an agent on scenarios and prints the row of the table.

    drivetrain evaluate runs/bc --data data/womd --split test --sim-agent idm

    With --record, the row is that of the actions in the file, played again: so it is,
    to the last digit, that of `drivetrain evaluate recorded --actions FILE` with the
    same data, objects and sim agents.

    Args:
        agent: expert, coast, random, constant_speed, idm, recorded, or the folder of a
            run.
        data: a store, a file, a quoted pattern of files, or synthetic:FIRST:COUNT for
            generated scenarios of the seeds from FIRST on.
        split: which part of the scenarios, by a hash of their ids.
        test_share: of the scenarios that belongs to the split test.
        query: which of them to play, by what is known of them.
        sim_agent: who drives all others.
        dynamics: the ego's action space; bicycle by default, and that of the training
            for a run.
        max_objects: how many objects of a scenario to keep, the most relevant ones.
        max_scenarios: how many scenarios to play at most.
        quantize: pack files to 16-bit numbers; a store is as it was prepared.
        json: write the rows of the table to this file.
        dump: write what happened in each scenario to this folder, as .npz files.
        record: write the ego's actions to this file, an .npz archive.
        actions: the file of the actions of recorded.
        run_seed: which of the seeds that a run has trained, counted from 0; all of
            them, and their mean, by default.
        seed: of whatever is drawn.
    """
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed must be from 0 to 2^32 - 1, got {seed}.")
    outputs.require({"json": json, "record": record}, dump)
    players_of = evaluating.players_of(agent, dynamics, sim_agent, actions, run_seed)
    source = loader.Source(
        path=data,
        split=split,
        query=query,
        test_share=test_share,
        max_scenarios=max_scenarios,
        quantize=quantize,
    )
    loaded = banks.load(source, max_objects, meshes.data_mesh())
    console = rich_console.Console(stderr=True)
    console.print(banks.describe(loaded), highlight=False, markup=False)
    players = players_of(loaded)
    player = players[0]
    if len(players) > 1 and (record is not None or dump is not None):
        raise ValueError(
            f"'{agent}' has {len(players)} seeds; choose one with --run-seed to write "
            "what it does"
        )
    if record is not None:
        taken = evaluating.record(player, loaded, seed)
        recording.write(record, taken)
        again = evaluating.replayed(taken, str(record), None, sim_agent, loaded)
        player = dataclasses.replace(again, name=player.name)
        players = [player]
    rows = [evaluating.row(each, loaded, seed) for each in players]
    if len(rows) > 1:
        rows.append(tables.over_seeds(rows))
    tables.show(rows, f"{agent} on {data}")
    if json is not None:
        facts: tables.Row = {
            "data": data,
            "split": split,
            "test_share": test_share,
            **{f"query.{name}": x for name, x in dataclasses.asdict(query).items()},
            "max_scenarios": max_scenarios,
            "quantize": quantize,
            "max_objects": max_objects,
            "dynamics": player.dynamics,
            "seed": seed,
            "jax": jax.__version__,
        }
        tables.write_json(json, [facts | row for row in rows])
    if dump is not None:
        with progress("dumping", len(loaded.scenarios), unit="scenarios") as line:
            dumps.dump(player, loaded, seed, dump, line.update)


def benchmark(
    name: Annotated[
        Literal["runtime", "nocturne", "throughput", "training"],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="NAME"),
    ] = "runtime",
    /,
    data: str = "synthetic:2000000:64",
    scenarios: int = Settings.scenarios,
    objects: str = "",
    batches: str = "",
    sim_agent: SimAgent = "playback",
    seconds: float = Settings.seconds,
    max_memory_gb: float = Settings.max_memory_gb,
    json: pathlib.Path | None = None,
    report: pathlib.Path | None = None,
) -> None:
    """Measures how fast the simulator is.

    drivetrain benchmark runtime --data 'womd/*.tfrecord*' --objects 128 --batches 1,16

    runtime: what Waymax times in its tables 2 and 6. nocturne: Nocturne's observation
    and step, by both procedures of its appendix F. throughput: how many agents act in a
    second, over numbers of worlds and agents. training: an iteration of each learner,
    and what acting and learning cost apart.

    Args:
        name: what to measure: runtime, nocturne, throughput or training.
        data: a store, a file, a quoted pattern of files, or synthetic:FIRST:COUNT for
            generated scenarios.
        scenarios: how many of the data to use, those with the most objects.
        objects: object slots of a scenario, with commas between several numbers, such
            as 8,16; by default those of the papers, up to 128.
        batches: worlds at once, likewise, up to 1,024 for throughput; of bc
            demonstrations.
        sim_agent: who drives what is not controlled.
        seconds: how long to repeat each call.
        max_memory_gb: throughput leaves out programs that need more.
        json: write the rows of the table to this file.
        report: write report.html and the plots as SVG and PNG to this folder.
    """
    outputs.require({"json": json}, report)
    settings = Settings(
        data=data,
        scenarios=scenarios,
        objects=numbers("objects", objects),
        batches=numbers("batches", batches),
        sim_agent=sim_agent,
        seconds=seconds,
        max_memory_gb=max_memory_gb,
    )
    with timing.cold_compilation():
        benchmarking.benchmark(name, settings, json, report)


def demo(out: pathlib.Path = pathlib.Path("runs/demo"), seed: int = 0) -> None:
    """Trains a driver on generated scenarios, evaluates it and writes a report.

    Args:
        out: the folder of the run; what an earlier demo has trained there is used
            again.
        seed: of the training.
    """
    demos.demo(out, seed)


def data() -> None:
    """Says what is in data: drivetrain data summary | compare."""


COMMANDS = {
    "prepare": stores.prepare,
    "data": data,
    "train": train,
    "evaluate": evaluate,
    "curves": drawing.curves,
    "benchmark": benchmark,
    "demo": demo,
}
DATA_COMMANDS = {"summary": stores.summary, "compare": stores.compare}


def main() -> None:
    """Runs a command; bad input ends it with one sentence and exit code 2."""
    _use_compile_cache()
    words = spelling.spelt(sys.argv[1:])
    try:
        if words[:1] == ["data"]:
            _run(DATA_COMMANDS, "drivetrain data", data.__doc__ or "", words[1:])
        else:
            about = (
                "Trains driving policies inside a simulator that runs on the "
                "accelerator."
            )
            _run(COMMANDS, "drivetrain", about, words)
    except BrokenPipeError:  # whoever read the results has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except (ValueError, OverflowError, OSError) as error:
        if os.environ.get("DRIVETRAIN_DEBUG"):
            raise
        print(f"drivetrain: {_sentence(error)}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(
            "drivetrain: stopped; when run again, prepare goes on from its last shard, "
            "train and demo from their last checkpoint, and the others begin anew",
            file=sys.stderr,
        )
        sys.exit(130)


def _run(
    commands: Mapping[str, Callable[..., None]],
    prog: str,
    about: str,
    words: list[str],
) -> None:
    """Runs one of some commands.

    What is wrong with an option of a command that is told which it is comes under the
    option's own name; of a union of commands, tyro names a wrapper of its own.
    """
    if words and words[0] in commands:
        command = commands[words[0]]
        tyro.cli(command, prog=f"{prog} {words[0]}", args=words[1:])
    else:
        tyro.extras.subcommand_cli_from_dict(
            dict(commands), prog=prog, description=about, args=words
        )


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: '{error.filename}'"
    return str(error)


def _use_compile_cache() -> None:
    """Keeps compiled programs between commands."""
    folder = files.cache_folder() / "programs"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
