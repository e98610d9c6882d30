"""Evaluates an agent now and then while it trains."""

import dataclasses
from dataclasses import field

import jax
import numpy as np
from jax.sharding import Mesh

from ..agents.base import Agent, Params
from ..learners import acting, mesh as meshes
from ..learners.evaluator import compile_evaluator, figures_of
from ..sim import ranges
from ..sim.data.loader import Source, Split
from ..sim.data.query import EVERYTHING, Query
from ..sim.env.base import Environment
from . import banks, tables

PREFIX = "evaluation/"  # of the names of figures in the log


@dataclasses.dataclass(frozen=True, kw_only=True)
class MonitorConfig:
    """On what, and how often."""

    data: str  # as that of the training
    every: int = 1000  # updates; a multiple of updates_per_call
    split: Split = "all"
    test_share: float = 1 / 3
    query: Query = field(default_factory=lambda: EVERYTHING)
    max_scenarios: int | None = None
    sim_agent: str = "playback"  # drives all others
    # Keeps the checkpoints with the best of a figure, such as log_ade_m, too; None: of
    # no figure. With several seeds it is their mean.
    best_by: str | None = None
    keep_best: int = 1  # of those checkpoints

    def __post_init__(self) -> None:
        """Checks the counts and the figure.

        Raises:
            ValueError: if evaluations would never come, or there is no such figure.
        """
        ranges.require_at_least(self, every=1, keep_best=1)
        if self.best_by is not None:
            tables.column(self.best_by)

    @property
    def source(self) -> Source:
        """Where the scenarios come from."""
        return Source(
            path=self.data,
            split=self.split,
            test_share=self.test_share,
            query=self.query,
            max_scenarios=self.max_scenarios,
        )


class Monitor:
    """Scenarios kept on the devices, on which an agent is evaluated again and again.

    Parameters stay where they are: nothing but the figures comes to the host.
    """

    def __init__(
        self,
        config: MonitorConfig,
        env: Environment,
        agent: Agent,
        max_objects: int,
        mesh: Mesh,
    ):
        """Loads the scenarios.

        Raises:
            FileNotFoundError: if there are no such data.
            ValueError: if there is no usable scenario.
        """
        self._loaded = banks.load(config.source, max_objects, mesh)
        driver_of = acting.greedy(agent, env)
        self._evaluate = compile_evaluator(env, driver_of, mesh, figures_of(env))
        self._key = meshes.replicate(mesh, jax.random.key(0))

    def evaluate(self, params: Params) -> dict[str, float]:
        """Returns the figures of the table by name, means over the episodes."""
        episodes = self._evaluate(params, self._loaded.bank, self._key, _say_nothing)
        return {
            PREFIX + column.key: mean
            for column in tables.COLUMNS
            if column.metric in episodes.value
            for mean in _mean(episodes, column)
        }


def _say_nothing(done: int) -> None:
    """Takes note of how many scenarios are done."""


def _mean(episodes, column: tables.Column) -> list[float]:
    """Returns the mean over the episodes that have the figure, if there are any."""
    values = np.asarray(episodes.value[column.metric], np.float64)
    valid = np.asarray(episodes.valid[column.metric]) & np.isfinite(values)
    return [float(values[valid].mean() * column.scale)] if valid.any() else []
