"""Trains an agent as a config says, and continues where a run was cut."""

import contextlib
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from rich import console as rich_console

from ..learners import checkpoint, mesh as meshes
from ..learners.base import Metrics, TrainState
from ..learners.program import Program, compile_program, initial_state
from ..sim import files
from . import banks, config, feeds, logbook
from .experiment import Experiment, agent, environment, learner
from .feeds import Feed
from .progress import progress

CONFIG = "config.yaml"
CHECKPOINTS = "checkpoints"
PARAMS = ".params"  # of the train state in a checkpoint


def train(experiment: Experiment, folder: pathlib.Path) -> TrainState:
    """Runs an experiment, or the rest of one that was cut.

    Writes to the folder: `config.yaml` (as resolved), `metrics.jsonl` and TensorBoard's
    files, and `checkpoints/`. A run that was cut and continued gives the same
    parameters, bit for bit, as one that was not.

    Returns:
        The train state after the last update.

    Raises:
        FileExistsError: if the folder holds another experiment.
        FileNotFoundError: if there are no such data.
        ValueError: if the experiment does not fit together.
    """
    _check_folder(folder, experiment)
    files.require_writable(folder)
    env = environment(experiment)
    console = rich_console.Console(stderr=True)
    mesh = meshes.data_mesh()
    feed = feeds.open_feed(
        experiment.source,
        experiment.stream,
        experiment.max_objects,
        mesh,
        experiment.seed,
    )
    console.print(feed.describe(), highlight=False, markup=False)

    driver = agent(experiment, env, banks.one_shard(feed.bank))
    made = learner(experiment, env, driver)
    program = compile_program(made, mesh, experiment.updates_per_call)
    state = initial_state(made, mesh, jax.random.key(experiment.seed), feed.bank)
    files.write_whole(folder / CONFIG, config.to_yaml(experiment))

    checkpoints = checkpoint.Checkpoints(folder / CHECKPOINTS)
    if checkpoints.steps():
        restored = checkpoints.restore(state)
        _check_same(restored.metadata, feed.identity, folder)
        state = restored.tree
        feed.restore(restored.metadata["feed"])
        console.print(
            f"continuing {folder} at update {restored.step:,}",
            highlight=False,
            markup=False,
        )

    def save(state: TrainState, done: int) -> None:
        checkpoints.save_async(done, state, {**feed.identity, "feed": feed.state()})

    with contextlib.closing(feed):
        with logbook.Logbook(folder, resume_step=int(state.step)) as log:
            state = _run(experiment, program, feed, state, log, save)
            checkpoints.wait()
    return state


def _run(
    experiment: Experiment,
    program: Program,
    feed: Feed,
    state: TrainState,
    log: logbook.Logbook,
    save: Callable[[TrainState, int], None],
) -> TrainState:
    done, total = int(state.step), experiment.updates
    with progress("training", total, unit="updates", start=done) as line:
        while done < total:
            state, metrics = program(state, feed.bank)
            done += experiment.updates_per_call
            feed.begin(done)
            scalars = _means(metrics)
            log.write(done, scalars | feed.exchange())
            line.update(done, f"loss {scalars['loss']:.3f}")
            is_last = done == total
            if is_last or done % experiment.updates_per_checkpoint == 0:
                save(state, done)
    return state


def _means(metrics: Metrics) -> dict[str, float]:
    """Returns the means over the updates of a call; what no update met is left out."""
    sums = {
        name: (float(np.sum(mean.total)), float(np.sum(mean.weight)))
        for name, mean in jax.device_get(metrics).items()
    }
    return {name: total / weight for name, (total, weight) in sums.items() if weight}


def _check_folder(folder: pathlib.Path, experiment: Experiment) -> None:
    path = folder / CONFIG
    if not path.exists():
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise FileExistsError(
                f"'{folder}' is there and no run; name a new folder with --out"
            )
    elif config.load(path, Experiment) != experiment:
        raise FileExistsError(
            f"'{folder}' holds a run of another config; name another folder with "
            "--out, or delete this one first"
        )


def _check_same(
    saved: Mapping[str, Any], identity: Mapping[str, Any], folder: pathlib.Path
) -> None:
    """Checks that a run finds again what it needs to go on as if it was not cut."""
    for name, value in identity.items():
        if saved.get(name) != value:
            raise ValueError(
                f"'{folder}' was trained with other {name} ({saved.get(name)}, now "
                f"{value}), so it would not go on as it was; bring them back, or train "
                "into another folder with --out"
            )


def load_run(folder: pathlib.Path) -> Experiment:
    """Returns the experiment of a run's folder.

    Raises:
        FileNotFoundError: if the folder holds no run, or one without a checkpoint.
        ValueError: if its config is damaged.
    """
    if not (folder / CONFIG).is_file():
        raise FileNotFoundError(
            f"'{folder}' is no run: {CONFIG} is missing; make one with 'drivetrain "
            "train'"
        )
    if not checkpoint.Checkpoints(folder / CHECKPOINTS).steps():
        raise FileNotFoundError(
            f"'{folder}' has no checkpoint yet; continue it with 'drivetrain train'"
        )
    return config.load(folder / CONFIG, Experiment)
