"""Finds who is to play: rules by name, trained agents by folder, recorded actions."""

import dataclasses
import functools
import pathlib
from collections.abc import Callable

import jax
from jaxtyping import Array, PyTree
from rich import console as rich_console

from ..learners import acting, mesh as meshes
from ..learners.seeds import one_of
from ..sim.dynamics import build as dynamics
from ..sim.env import build as tasks, drivers
from ..sim.env.base import Driver, Environment
from ..sim.observations.vector import VectorConfig, vector
from . import actions, runs
from .actions import RECORDED, Record
from .banks import Loaded
from .experiment import agent, environment, keys

SIMPLE = VectorConfig(history=0, num_objects=1, num_road=1, num_lights=1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Player:
    """An agent ready to drive in an environment."""

    name: str
    sim_agent: str
    dynamics: str  # of the ego
    env: Environment
    driver_of: Callable[[PyTree, Array], Driver]  # of the number of a scenario too
    params: PyTree  # a copy on each device; empty for rules
    run_seed: int | None = None  # which of those that a run has trained
    update: int | None = None  # of the run, after which it was saved


def players_of(
    agent: str,
    dynamics_name: str | None,
    sim_agent: str,
    record: pathlib.Path | None = None,
    seed: int | None = None,
    checkpoint: str = runs.NEWEST,
) -> Callable[[Loaded], list[Player]]:
    """Finds an agent by name, or by the folder of its run, before data are loaded.

    Args:
        agent: the name of a rule, `recorded`, or a folder.
        dynamics_name: the ego's action space; None for that of the training, and the
            bicycle for rules.
        sim_agent: drives all others.
        record: the file of the actions of `recorded`.
        seed: which of the seeds of a run, counted from 0; None for all.
        checkpoint: of a run: newest, best, or the number of an update.

    Returns:
        A function from the scenarios to the players: one, or one for each seed.

    Raises:
        FileNotFoundError: if the folder holds no run, or one without such a
            checkpoint, or there is no file of actions.
        ValueError: if a name is unknown, the run was trained or recorded with other
            dynamics, or the file holds no actions.
    """
    if (agent == RECORDED) != (record is not None):
        raise ValueError(
            "a record is played by naming both: drivetrain evaluate recorded --actions "
            f"FILE; got the agent '{agent}' "
            + (f"with --actions {record}" if record else "without --actions")
        )
    if record is not None:
        taken = actions.read(record)
        return lambda loaded: [
            replayed(taken, str(record), dynamics_name, sim_agent, loaded)
        ]
    folder = pathlib.Path(agent)
    if agent in drivers.NAMES or not folder.is_dir():
        player = rule(agent, dynamics_name or "bicycle", sim_agent)
        return lambda loaded: [player]
    space = runs.load(folder).dynamics
    if dynamics_name not in (None, space):
        raise ValueError(
            f"'{agent}' was trained with --dynamics {space}, not {dynamics_name}; "
            "leave the option out"
        )
    return functools.partial(trained, folder, sim_agent, seed, checkpoint)


def rule(name: str, dynamics_name: str, sim_agent: str) -> Player:
    """Makes a player of a driver by name.

    Raises:
        ValueError: if a name is unknown.
    """
    driver = drivers.build(name, dynamics.build(dynamics_name))
    env = _simple(dynamics_name, sim_agent)
    return Player(
        name=name,
        sim_agent=sim_agent,
        dynamics=dynamics_name,
        env=env,
        driver_of=lambda params, number: driver,
        params=(),
    )


def _simple(dynamics_name: str, sim_agent: str) -> Environment:
    """Builds a task for those who look at nothing."""
    task = tasks.PlanningConfig(sim_agent=sim_agent)
    return tasks.build(task, dynamics.build(dynamics_name), vector(SIMPLE))


def trained(
    folder: pathlib.Path,
    sim_agent: str,
    seed: int | None,
    checkpoint: str,
    loaded: Loaded,
) -> list[Player]:
    """Makes players of a checkpoint of a run, one for each seed.

    Args:
        folder: of the run.
        sim_agent: drives all others.
        seed: which of the run's, counted from 0; None for all.
        checkpoint: newest, best, or the number of an update; of those that are damaged
            the next one is taken.
        loaded: scenarios; only their shapes are read.

    Raises:
        FileNotFoundError: if there is no such run or it has no such checkpoint.
        ValueError: if a name is unknown, the checkpoint does not fit the config, or the
            run has no such seed.
    """
    experiment = runs.load(folder)
    if seed is not None and not 0 <= seed < experiment.seeds:
        raise ValueError(
            f"'{folder}' has the seeds 0 to {experiment.seeds - 1}, got {seed}."
        )
    env = environment(experiment, sim_agent)
    made = agent(experiment, env, loaded.one_shard)
    mesh = meshes.data_mesh()
    init = made.init if experiment.seeds == 1 else jax.vmap(made.init)
    like = meshes.replicate(mesh, jax.jit(init)(keys(experiment)))
    there = runs.checkpoints(folder, experiment)
    allowed = runs.steps(folder, there, checkpoint)
    restored = there.restore_part(like, runs.PARAMS, allowed)
    console = rich_console.Console(stderr=True)
    console.print(
        f"{folder} at update {restored.step:,}", highlight=False, markup=False
    )
    player = Player(
        name=folder.name,
        sim_agent=sim_agent,
        dynamics=experiment.dynamics,
        env=env,
        driver_of=acting.greedy(made, env),
        params=restored.tree,
        update=restored.step,
    )
    if experiment.seeds == 1:
        return [player]
    numbers = range(experiment.seeds) if seed is None else (seed,)
    return [
        dataclasses.replace(
            player, params=one_of(restored.tree, number), run_seed=number
        )
        for number in numbers
    ]


def replayed(
    record: Record,
    source: str,
    dynamics_name: str | None,
    sim_agent: str,
    loaded: Loaded,
) -> Player:
    """Makes a player of recorded actions.

    Args:
        record: the actions.
        source: where they come from.
        dynamics_name: the ego's action space; None for that of the record.
        sim_agent: drives all others.
        loaded: the scenarios on which they were recorded.

    Raises:
        ValueError: if they were recorded with other dynamics, or on other scenarios.
    """
    if dynamics_name not in (None, record.dynamics):
        raise ValueError(
            f"'{source}' was recorded with --dynamics {record.dynamics}, not "
            f"{dynamics_name}; leave the option out"
        )
    record.require_fits(loaded, source)
    different = ", ".join(record.differences(loaded, sim_agent))
    if different:
        rich_console.Console(stderr=True).print(
            f"'{source}' was recorded otherwise, so rollouts may differ: {different}",
            highlight=False,
            markup=False,
        )
    return Player(
        name=RECORDED,
        sim_agent=sim_agent,
        dynamics=record.dynamics,
        env=_simple(record.dynamics, sim_agent),
        driver_of=actions.driver_of,
        params=meshes.replicate(meshes.data_mesh(), record.actions),
    )
