"""Plays agents on scenarios and makes the rows of tables."""

import dataclasses
import functools
import pathlib
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import PyTree
from rich import console as rich_console

from ..learners import acting, checkpoint, mesh as meshes
from ..learners.evaluator import compile_evaluator
from ..learners.program import initial_state
from ..sim.dynamics import build as dynamics
from ..sim.env import drivers
from ..sim.env.base import Driver, Environment
from ..sim.observations.vector import VectorConfig
from . import tables
from .banks import Loaded
from .experiment import agent, environment, learner
from .progress import progress
from .train import CHECKPOINTS, load_run

SIMPLE = VectorConfig(history=0, num_objects=1, num_road=1, num_lights=1)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Player:
    """An agent ready to drive in an environment."""

    name: str
    sim_agent: str
    env: Environment
    driver_of: Callable[[PyTree], Driver]
    params: PyTree  # a copy on each device; empty for rules


def player_of(
    agent: str, dynamics_name: str | None, sim_agent: str
) -> Callable[[Loaded], Player]:
    """Finds an agent by name, or by the folder of its run, before data are loaded.

    Args:
        agent: the name of a rule, or a folder.
        dynamics_name: the ego's action space; None for that of the training, and the
            bicycle for rules.
        sim_agent: drives all others.

    Returns:
        A function from the scenarios to the player.

    Raises:
        FileNotFoundError: if the folder holds no run, or one without a checkpoint.
        ValueError: if a name is unknown, or the run was trained with other dynamics.
    """
    folder = pathlib.Path(agent)
    if agent in drivers.NAMES or not folder.is_dir():
        player = rule(agent, dynamics_name or "bicycle", sim_agent)
        return lambda loaded: player
    space = load_run(folder).dynamics
    if dynamics_name not in (None, space):
        raise ValueError(
            f"'{agent}' was trained with --dynamics {space}, not {dynamics_name}; "
            "leave the option out"
        )
    return functools.partial(trained, folder, sim_agent)


def rule(name: str, dynamics_name: str, sim_agent: str) -> Player:
    """Makes a player of a driver by name.

    Raises:
        ValueError: if a name is unknown.
    """
    driver = drivers.build(name, dynamics.build(dynamics_name))
    env = environment(SIMPLE, dynamics_name, sim_agent)
    return Player(
        name=name, sim_agent=sim_agent, env=env, driver_of=lambda _: driver, params=()
    )


def trained(folder: pathlib.Path, sim_agent: str, loaded: Loaded) -> Player:
    """Makes a player of the newest checkpoint of a run.

    Args:
        folder: of the run.
        sim_agent: drives all others.
        loaded: scenarios; only their shapes are read.

    Raises:
        FileNotFoundError: if there is no such run or it has no checkpoint.
        ValueError: if a name is unknown or the checkpoint does not fit the config.
    """
    experiment = load_run(folder)
    env = environment(experiment.observation, experiment.dynamics, sim_agent)
    made = agent(experiment, env, loaded.one_shard)
    mesh = meshes.data_mesh()
    like = initial_state(learner(experiment, made), mesh, jax.random.key(0))
    restored = checkpoint.Checkpoints(folder / CHECKPOINTS).restore(like)
    console = rich_console.Console(stderr=True)
    console.print(
        f"{folder} at update {restored.step:,}", highlight=False, markup=False
    )
    return Player(
        name=folder.name,
        sim_agent=sim_agent,
        env=env,
        driver_of=acting.greedy(made, env),
        params=restored.tree.params,
    )


def play(player: Player, loaded: Loaded, seed: int) -> dict[str, np.ndarray]:
    """Plays every scenario and returns each figure by episode, with its mask."""
    mesh = meshes.data_mesh()
    evaluate = compile_evaluator(player.env, player.driver_of, mesh)
    key = meshes.replicate(mesh, jax.random.key(seed))
    total = len(loaded.scenarios)
    with progress(f"evaluating {player.name}", total, unit="scenarios") as line:
        episodes = evaluate(player.params, loaded.bank, key, line.update)
    masks = {f"{name}_mask": valid for name, valid in episodes.valid.items()}
    return {name: np.asarray(x) for name, x in {**episodes.value, **masks}.items()}


def row(player: Player, loaded: Loaded, seed: int) -> tables.Row:
    """Plays every scenario and returns the row of the table."""
    return tables.summarize(
        play(player, loaded, seed),
        agent=player.name,
        sim_agent=player.sim_agent,
        seed=seed,
    )
