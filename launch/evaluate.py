"""Plays agents on scenarios and makes the rows of tables: `drivetrain evaluate`."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Annotated

import jax
import numpy as np
import tyro
from jaxtyping import PyTree
from rich import console as rich_console

from ..learners import actors, mesh as meshes
from ..learners.evaluator import compile_evaluator, figures_of
from ..sim.data import loader
from ..sim.data.loader import Split
from ..sim.data.query import EVERYTHING, Query
from ..sim.dynamics.build import DYNAMICS
from ..sim.sim_agents.build import SIM_AGENTS
from . import actions as recording, banks, dump as dumps, outputs, runs, tables
from .banks import Loaded
from .players import Player, players_of, replayed
from .progress import progress

Dynamics = Annotated[str, tyro.conf.arg(metavar="|".join(DYNAMICS))]
SimAgent = Annotated[str, tyro.conf.arg(metavar="|".join(SIM_AGENTS))]
UNSEEN = "synthetic:2000000:256"  # generated scenarios that nothing trains on


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
    checkpoint: str = runs.NEWEST,
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
        checkpoint: of a run: newest, best (by its monitor), or the number of an update.
        seed: of whatever is drawn.
    """
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed must be from 0 to 2^32 - 1, got {seed}.")
    outputs.require({"json": json, "record": record}, dump)
    find = players_of(agent, dynamics, sim_agent, actions, run_seed, checkpoint)
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
    players = find(loaded)
    if len(players) > 1 and (record is not None or dump is not None):
        raise ValueError(
            f"'{agent}' has {len(players)} seeds; choose one with --run-seed to write "
            "what it does"
        )
    if record is not None:
        players = [_recorded(players[0], loaded, seed, record)]
    rows = [row(each, loaded, seed) for each in players]
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
            "dynamics": players[0].dynamics,
            "seed": seed,
            "jax": jax.__version__,
        }
        tables.write_json(json, [facts | row for row in rows])
    if dump is not None:
        with progress("dumping", len(loaded.scenarios), unit="scenarios") as line:
            dumps.dump(players[0], loaded, seed, dump, line.update)


def _recorded(player: Player, loaded: Loaded, seed: int, path: pathlib.Path) -> Player:
    """Writes the ego's actions to a file; returns the player of what was written."""
    taken = recording.Record(
        scenario_ids=tuple(
            scenario.scenario_id for scenario in loaded.scenarios.values()
        ),
        dynamics=player.dynamics,
        sim_agent=player.sim_agent,
        num_objects=loaded.bank.sizes.num_objects,
        quantized=recording.is_quantized(loaded),
        actions=_play(player, loaded, seed, "recording", lambda steps: steps.action),
    )
    recording.write(path, taken)
    again = replayed(taken, str(path), None, player.sim_agent, loaded)
    return dataclasses.replace(again, name=player.name)


def play(player: Player, loaded: Loaded, seed: int) -> dict[str, np.ndarray]:
    """Plays every scenario and returns each figure by episode, with its mask.

    Raises:
        ValueError: if the ego is nowhere at some step.
    """
    episodes = _play(player, loaded, seed, "evaluating", figures_of(player.env))
    masks = {f"{name}_mask": valid for name, valid in episodes.valid.items()}
    found = {name: np.asarray(x) for name, x in {**episodes.value, **masks}.items()}
    if actors.is_multi_agent(player.env):
        return _of_actors(found)
    lost = found["log_ade_mask"] & ~np.isfinite(found["log_ade"])
    if np.any(lost):
        first = loaded.scenarios[int(np.argmax(lost))].scenario_id
        raise ValueError(
            f"'{player.name}' drove the ego to no place in {np.sum(lost)} scenarios, "
            f"'{first}' the first: its actions are no finite numbers"
        )
    return found


def _of_actors(found: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns the figures of every object that was controlled, [episodes]."""
    acted = found["collision_mask"]
    return {name: values[acted] for name, values in found.items()}


def _play(player: Player, loaded: Loaded, seed: int, doing: str, keep) -> PyTree:
    mesh = meshes.data_mesh()
    program = compile_evaluator(player.env, player.driver_of, mesh, keep)
    key = meshes.replicate(mesh, jax.random.key(seed))
    total = len(loaded.scenarios)
    with progress(f"{doing} {player.name}", total, unit="scenarios") as line:
        return program(player.params, loaded.bank, key, line.update)


def row(player: Player, loaded: Loaded, seed: int) -> tables.Row:
    """Plays every scenario and returns the row of the table."""
    found = tables.summarize(
        play(player, loaded, seed),
        agent=player.name,
        sim_agent=player.sim_agent,
        seed=seed,
    )
    of_run = {"run_seed": player.run_seed, "update": player.update}
    return found | {name: x for name, x in of_run.items() if x is not None}
