"""Trains an agent as a config says, and continues where a run was cut."""

import pathlib

import jax
from rich import console as rich_console

from ..learners import checkpoint, mesh as meshes
from ..learners.base import TrainState
from ..learners.program import Program, compile_program, initial_state
from ..sim.data.bank import Bank
from . import banks, config, files, logbook
from .experiment import Experiment, agent, environment, learner
from .progress import progress

CONFIG = "config.yaml"
CHECKPOINTS = "checkpoints"


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
    env = environment(experiment.observation, experiment.dynamics, "playback")
    console = rich_console.Console(stderr=True)
    mesh = meshes.data_mesh()
    loaded = banks.load(experiment.source, experiment.max_objects, mesh)
    console.print(banks.describe(loaded), highlight=False)

    made = learner(experiment, agent(experiment, env, loaded.one_shard))
    program = compile_program(made, mesh, experiment.updates_per_call)
    state = initial_state(made, mesh, jax.random.key(experiment.seed))
    files.write_whole(folder / CONFIG, config.to_yaml(experiment))

    checkpoints = checkpoint.Checkpoints(folder / CHECKPOINTS)
    if checkpoints.steps():
        state = checkpoints.restore(state).tree
        done = int(state.step)
        console.print(f"continuing {folder} at update {done:,}", highlight=False)
    return _run(experiment, folder, program, loaded.bank, state, checkpoints)


def _run(
    experiment: Experiment,
    folder: pathlib.Path,
    program: Program,
    bank: Bank,
    state: TrainState,
    checkpoints: checkpoint.Checkpoints,
) -> TrainState:
    start = int(state.step)
    with (
        logbook.Logbook(folder, resume_step=start or None) as log,
        progress("training", experiment.updates, unit="updates", start=start) as line,
    ):
        while start < experiment.updates:
            state, metrics = program(state, bank)
            start += experiment.updates_per_call
            scalars = {name: float(value) for name, value in metrics.items()}
            log.write(start, scalars)
            line.update(start, f"loss {scalars['loss']:.3f}")
            is_last = start == experiment.updates
            if is_last or start % experiment.updates_per_checkpoint == 0:
                checkpoints.save_async(start, state, {})
        checkpoints.wait()
    return state


def _check_folder(folder: pathlib.Path, experiment: Experiment) -> None:
    path = folder / CONFIG
    if path.exists() and config.load(path, Experiment) != experiment:
        raise FileExistsError(
            f"'{folder}' holds a run of another config; name another folder with "
            "--out, or delete this one first"
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
