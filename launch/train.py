"""Trains an agent as a config says, and continues where a run was cut."""

import contextlib
import dataclasses
import operator
import pathlib
import signal
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh
from rich import console as rich_console

from ..agents.base import Agent, Params
from ..learners import checkpoint, mesh as meshes
from ..learners.base import Metrics, Program, TrainState
from ..learners.program import compile_program, initial_state
from ..learners.seeds import one_of
from ..sim import files, names, pytrees
from . import (
    banks,
    cluster,
    config,
    divergence,
    feeds,
    interrupts,
    locks,
    logbook,
    nans,
    runs,
    versions,
)
from .experiment import Experiment, agent, environment, keys, learner, over_seeds
from .feeds import Feed
from .monitor import Monitor
from .progress import progress

Write = Callable[[int, Mapping[str, Any]], None]  # of a step, its scalars
STOPPING = "stopping after these updates, to save them; once more stops at once"


def train(
    experiment: Experiment, folder: pathlib.Path, debug_nans: bool = False
) -> TrainState:
    """Runs an experiment, or the rest of one that was cut.

    Writes to the folder: `config.yaml` (as resolved), `metrics.jsonl` and TensorBoard's
    files, and `checkpoints/`. A run that was cut and continued gives the same
    parameters, bit for bit, as one that was not. Ctrl-C and SIGTERM end it after the
    updates under way, which are saved.

    Args:
        experiment: what to run.
        folder: of the run.
        debug_nans: look for the operation where a loss becomes no number.

    Returns:
        The train state after the last update.

    Raises:
        BlockingIOError: if another job trains in the folder.
        FileExistsError: if the folder holds another experiment.
        FileNotFoundError: if there are no such data, or no run to begin with.
        DivergedError: if the loss is no number any more.
        NoNumberError: likewise, if the operation was found.
        ValueError: if the experiment does not fit together.
    """
    runs.require_room(folder, experiment)
    files.require_writable(folder)
    checkpoints = runs.checkpoints(folder, experiment)
    if experiment.pretrained is not None and not checkpoints.steps():
        runs.load(pathlib.Path(experiment.pretrained))
    env = environment(experiment)  # before data are loaded: it knows wrong names
    mesh = meshes.data_mesh()
    feed = feeds.open_feed(
        experiment.source,
        experiment.stream,
        experiment.max_objects,
        mesh,
        experiment.learner.strata,
        experiment.seed,
        checkpoints.metadata(),
    )
    _say(feed.describe())
    driver = agent(experiment, env, banks.one_shard(feed.bank))
    learns = learner(experiment, env, driver)
    spread = over_seeds(experiment)
    program = compile_program(learns, mesh, experiment.updates_per_call, spread)
    if debug_nans:
        single = compile_program(learns, mesh, 1, spread)
        program = nans.searched(program, single, _say)
    with contextlib.closing(feed), _alone(folder, experiment):
        state = initial_state(learns, mesh, keys(experiment), feed.bank)
        watch = _watch(experiment, driver, mesh)
        if checkpoints.steps():
            restored = checkpoints.restore(state)
            _check_same(restored.metadata, feed.identity, folder)
            _say(f"continuing {folder} at update {restored.step:,}")
            _warn_of_versions(restored.metadata)
            state = _resume(restored, state, feed)
        elif experiment.pretrained is not None:
            adopt = learns.adopt if experiment.seeds == 1 else jax.vmap(learns.adopt)
            state = adopt(state, _pretrained(experiment, state.params, mesh))

        if _updates(state) >= experiment.updates:
            _say(f"{folder} has been trained to its end")
        if meshes.is_first():
            files.write_whole(folder / runs.CONFIG, config.to_yaml(experiment))
        run = Run(experiment, folder, program, feed, watch, checkpoints)
        with _log(folder, _updates(state)) as write:
            return _run(run, state, write)


@dataclasses.dataclass(frozen=True)
class Run:
    """A training run ready to go."""

    experiment: Experiment
    folder: pathlib.Path
    program: Program
    feed: Feed
    watch: Callable[[TrainState], dict[str, float]]
    checkpoints: checkpoint.Checkpoints


def _run(run: Run, state: TrainState, write: Write) -> TrainState:
    experiment, feed = run.experiment, run.feed
    done, total = _updates(state), experiment.updates
    with (
        progress("training", total, unit="updates", start=done) as line,
        interrupts.noted((signal.SIGINT, signal.SIGTERM), STOPPING) as notice,
    ):
        while done < total:
            state, metrics = run.program(state, feed.bank)
            first, done = done + 1, done + experiment.updates_per_call
            feed.begin(done)
            metrics = jax.device_get(metrics)
            divergence.require_finite(metrics, first, run.folder, run.checkpoints.saved)
            scalars = _means(metrics) | feed.exchange()
            monitor, found = experiment.monitor, {}
            if monitor is not None and done % monitor.every == 0:
                found = run.watch(state)
            write(done, scalars | found)
            line.update(
                done, f"loss {scalars['loss']:.3f}" if "loss" in scalars else ""
            )
            is_last = done == total or _any(notice.came)
            if is_last or done % experiment.updates_per_checkpoint == 0:
                run.checkpoints.save_async(done, state, _told(run, found))
            if is_last:
                run.checkpoints.wait()
                break
        if done < total:
            _say(f"saved {run.folder} at update {done:,}")
    return state


def _told(run: Run, found: Mapping[str, float]) -> dict[str, Any]:
    """Returns what a checkpoint says beside the train state."""
    feed = run.feed
    return {
        **feed.identity,
        "layout": feed.layout,
        "feed": feed.state(),
        runs.EVALUATION: found,
        runs.VERSIONS: versions.here(),
        "config": config.to_yaml(run.experiment),
    }


@contextlib.contextmanager
def _alone(folder: pathlib.Path, experiment: Experiment) -> Iterator[None]:
    """Holds the lock of a folder: only the first process does, which alone writes."""
    if not meshes.is_first():
        yield
        return
    with locks.held(folder):
        runs.require_room(
            folder, experiment
        )  # what another job has made of it meanwhile
        yield


@contextlib.contextmanager
def _log(folder: pathlib.Path, step: int) -> Iterator[Write]:
    """Opens the logbook, and yields what writes to it: only the first process does."""
    if not meshes.is_first():
        yield lambda step, scalars: None
        return
    with logbook.Logbook(folder, resume_step=step) as log:
        yield log.write


def _any(was_told: bool) -> bool:
    """Tells whether any process was told to end: all end after the same updates."""
    return bool(meshes.largest(np.array(was_told)))


def _resume(restored: checkpoint.Restored, fresh: TrainState, feed: Feed) -> TrainState:
    """Returns the train state of a checkpoint, fitted to the devices here."""
    before, now = restored.metadata["layout"], feed.layout
    if before == now:
        feed.restore(restored.metadata["feed"])
        return restored.tree
    state, told = feed.redeal(restored.tree, fresh, before)
    changes = [f"{name} {now[name]}, before {before.get(name)}" for name in now]
    _say(f"dealt anew ({'; '.join(changes)}): {told}")
    return state


def _updates(state: TrainState) -> int:
    """Returns how many updates are done, by each seed."""
    return int(np.max(state.step))


def _means(metrics: Metrics) -> dict[str, float]:
    """Returns the means over the updates of a call; what none has met is left out.

    With several seeds, those of each, as `seed2/loss`, beside those of all.
    """
    means: dict[str, float] = {}
    for name, mean in metrics.items():
        total, weight = np.sum(mean.total, axis=0), np.sum(mean.weight, axis=0)
        if np.sum(weight):
            means[name] = float(np.sum(total) / np.sum(weight))
        if np.ndim(total):
            means |= {
                f"seed{number}/{name}": float(total[number] / weight[number])
                for number in np.flatnonzero(weight)
            }
    return means


def _watch(
    experiment: Experiment, driver: Agent, mesh: Mesh
) -> Callable[[TrainState], dict[str, float]]:
    """Returns what evaluates the agent of each seed while it trains."""
    wanted = experiment.monitor
    if wanted is None:
        return lambda state: {}
    env = environment(experiment, wanted.sim_agent)
    monitor = Monitor(wanted, env, driver, experiment.max_objects, mesh)
    if experiment.seeds == 1:
        return lambda state: monitor.evaluate(state.params)

    def of_each(state: TrainState) -> dict[str, float]:
        """Returns the means over seeds, and the figures of each as `seed2/…`."""
        numbers = range(experiment.seeds)
        found = [monitor.evaluate(one_of(state.params, number)) for number in numbers]
        everywhere = set.intersection(*map(set, found))
        means = {
            name: float(np.mean([figures[name] for figures in found]))
            for name in sorted(everywhere)
        }
        return means | {
            f"seed{number}/{name}": value
            for number in numbers
            for name, value in found[number].items()
        }

    return of_each


def _pretrained(experiment: Experiment, params: Params, mesh: Mesh) -> Params:
    """Returns the parameters with some parts of another run's.

    Seed i begins with seed i of those of that run, counted round.
    """
    folder = pathlib.Path(experiment.pretrained or "")
    before = runs.load(folder)
    there, here = before.seeds, experiment.seeds
    numbers = np.arange(here) % there
    checkpoints = runs.checkpoints(folder, before)
    for part in experiment.pretrained_parts:
        if part not in params:
            raise names.unknown("part in pretrained_parts", part, sorted(params))
        like = params[part]
        one = like if here == 1 else one_of(like, 0)
        like = one if there == 1 else pytrees.spread(one, there)
        try:
            restored = checkpoints.restore_part(like, f"{runs.PARAMS}['{part}']")
        except ValueError as error:
            raise ValueError(f"pretrained {part} of '{folder}': {error}") from error
        of_each = restored.tree if there > 1 else pytrees.spread(restored.tree, 1)
        found = jax.tree.map(operator.itemgetter(numbers), of_each)
        found = found if here > 1 else one_of(found, 0)
        params = {**params, part: meshes.replicate(mesh, found)}
        _say(f"{part} from {folder} at update {restored.step:,}")
    return params


def _say(line: str) -> None:
    console = rich_console.Console(stderr=True, quiet=not cluster.speaks())
    console.print(line, highlight=False, markup=False, soft_wrap=True)


def _warn_of_versions(saved: Mapping[str, Any]) -> None:
    if changes := versions.changes(saved.get(runs.VERSIONS, {})):
        _say(f"not bit for bit as it would have gone: {'; '.join(changes)}")


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
