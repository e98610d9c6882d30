"""Runs the commands: `drivetrain prepare | data | train | evaluate …`."""

import os
import pathlib
import shlex
import sys
from collections.abc import Callable, Mapping
from typing import Annotated, Literal

import jax
import tyro

from ..sim import files
from ..sim.data import loader
from . import (
    benchmark as benchmarking,
    checkpoints,
    cluster,
    config,
    curves as drawing,
    demo as demos,
    interrupts,
    job as jobs,
    outputs,
    spelling,
    stores,
)
from .benchmarks import timing
from .benchmarks.base import Settings, numbers
from .evaluate import SimAgent, evaluate
from .experiment import Experiment
from .job import JobConfig
from .train import train as run_training


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
    processes: int = JobConfig.processes,
    devices_per_process: int | None = JobConfig.devices_per_process,
    restarts: int = JobConfig.restarts,
) -> None:
    """Trains an agent as a config says.

    drivetrain train configs/bc.yaml data=data/womd learner.learning_rate=3e-5

    The same command continues a run that was cut.

    Args:
        config_file: a YAML file; see configs/.
        fields: any of its fields, as field=value.
        out: the folder of the run; by default runs/ and the name of the config.
        debug_nans: where a loss becomes no number, go through that update operation by
            operation, and name the first whose result is none.
        processes: of this machine, that train together; whatever ends one of them ends
            all. Under Slurm, Open MPI and on Cloud TPU, let those start them.
        devices_per_process: of the accelerators that processes share; without any, as
            many virtual devices of CPU.
        restarts: how often to go on from the last checkpoint where a process fails.
    """
    job = JobConfig(
        processes=processes, devices_per_process=devices_per_process, restarts=restarts
    )
    experiment = config.load(config_file, Experiment, fields)
    folder = out or pathlib.Path("runs") / config_file.stem
    if job != JobConfig() and cluster.PROCESSES not in os.environ:
        sys.exit(jobs.run(sys.argv[1:], job))
    cluster.join()
    _warn_of_pages(experiment)
    run_training(experiment, folder, debug_nans)
    if not cluster.speaks():
        return
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


def checkpoint() -> None:
    """Looks at the checkpoints of a run: drivetrain checkpoint list | verify."""


COMMANDS: dict[str, Callable[..., None]] = {
    "prepare": stores.prepare,
    "data": data,
    "train": train,
    "checkpoint": checkpoint,
    "evaluate": evaluate,
    "curves": drawing.curves,
    "benchmark": benchmark,
    "demo": demo,
}
GROUPS = {
    "data": {"summary": stores.summary, "compare": stores.compare},
    "checkpoint": {"list": checkpoints.show, "verify": checkpoints.verify},
}


def main() -> None:
    """Runs a command; bad input ends it with one sentence and exit code 2."""
    _use_compile_cache()
    words = spelling.spelt(sys.argv[1:])
    try:
        if words and words[0] in GROUPS:
            about = COMMANDS[words[0]].__doc__ or ""
            _run(GROUPS[words[0]], f"drivetrain {words[0]}", about, words[1:])
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
    except jax.errors.JaxRuntimeError as error:
        if cluster.PROCESSES not in os.environ or os.environ.get("DRIVETRAIN_DEBUG"):
            raise
        # Most likely another process is gone: whoever watches over all says which.
        print(f"drivetrain: {str(error).splitlines()[0]}", file=sys.stderr)
        sys.exit(cluster.LOST)
    except KeyboardInterrupt as stopped:
        print(
            "drivetrain: stopped; when run again, prepare goes on from its last shard, "
            "train and demo from their last checkpoint, and the others begin anew",
            file=sys.stderr,
        )
        is_terminated = isinstance(stopped, interrupts.Terminated)
        sys.exit(interrupts.AGAIN if is_terminated else 130)


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
