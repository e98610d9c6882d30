"""States what an experiment is, and builds its parts."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import field

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from ..agents import build as agents
from ..agents.base import Agent
from ..learners import actors, build as learners, opponents, seeds
from ..learners.apg import AnalyticConfig
from ..learners.base import Learner, Program
from ..learners.bc import CloningConfig, Draw
from ..learners.forecasting import ForecastConfig
from ..learners.opponents import OpponentsConfig
from ..learners.pasts import Pasts
from ..learners.ppo import EnvironmentOf
from ..sim import ranges
from ..sim.data import loader
from ..sim.data.bank import Bank
from ..sim.data.loader import Split
from ..sim.data.query import EVERYTHING, Query
from ..sim.data.stream import StreamConfig
from ..sim.dynamics import build as dynamics
from ..sim.env import build as tasks
from ..sim.env.base import Environment
from ..sim.env.controlled import moving_vehicles
from ..sim.env.demonstrations import demonstrations
from ..sim.env.futures import futures
from ..sim.observations import build as observations
from ..sim.observations.vector import VectorConfig
from ..sim.sim_agents import build as sim_agents
from .monitor import MonitorConfig


@dataclasses.dataclass(frozen=True, kw_only=True)
class Experiment:
    """One training run, whole."""

    data: str  # a store, a file, a pattern of files, or synthetic:FIRST:COUNT
    split: Split = "all"  # which scenarios to train on
    test_share: float = 1 / 3  # of the scenarios, for the splits train and test
    query: Query = EVERYTHING  # which of them, by what is known of them
    max_scenarios: int | None = None
    stream: StreamConfig = field(default_factory=StreamConfig)
    max_objects: int = 128  # of a scenario, those that matter most to the ego
    dynamics: str = "bicycle_discrete"  # of whoever is controlled: the action space
    task: tasks.TaskConfig = field(default_factory=tasks.PlanningConfig)
    observation: observations.ObservationConfig = field(default_factory=VectorConfig)
    agent: agents.AgentConfig = field(default_factory=agents.AgentConfig)
    learner: learners.LearnerConfig = field(default_factory=CloningConfig)
    updates: int = 100_000  # of the learner, in all
    updates_per_call: int = 50  # of the compiled program
    updates_per_checkpoint: int = 1000
    keep_newest: int = 3  # of the checkpoints; monitor.best_by keeps others too
    seed: int = 0
    opponents: OpponentsConfig = field(default_factory=OpponentsConfig)  # in self-play
    # Trained in one program: seed, seed + 1, …; those of a stream share its pages.
    seeds: int = 1
    # One after another, as suits a CPU, instead of side by side, as suits a GPU.
    seeds_in_turn: bool = False
    monitor: MonitorConfig | None = None  # evaluates now and then
    pretrained: str | None = None  # the folder of a run whose parameters to begin with
    pretrained_parts: tuple[str, ...] = ("encoder",)  # of the parameters

    def __post_init__(self) -> None:
        """Checks the counts.

        Raises:
            ValueError: if a count is below 1, calls do not add up to checkpoints and
                these to the run, or the seed does not fit.
        """
        ranges.require_at_least(
            self,
            updates_per_call=1,
            updates_per_checkpoint=1,
            keep_newest=1,
            updates=1,
            seeds=1,
        )
        for whole, part in (
            ("updates", "updates_per_call"),
            ("updates_per_checkpoint", "updates_per_call"),
        ):
            if getattr(self, whole) % getattr(self, part):
                raise ValueError(
                    f"{whole} must be a multiple of {part}, got {getattr(self, whole)} "
                    f"and {getattr(self, part)}."
                )
        self._check_stream()
        self._check_monitor()
        self._check_opponents()
        decay, steps = self.learner.decay_updates, self.learner.gradient_steps
        if decay is not None and decay < self.updates * steps:
            raise ValueError(
                f"learner.decay_updates counts gradient steps, {steps:g} an update, so "
                f"after {decay / steps:,.0f} of {self.updates:,} updates nothing more "
                f"would be learned; set it to {math.ceil(self.updates * steps)}."
            )
        self._check_discounts()
        if not 0 <= self.seed <= 2**32 - self.seeds:
            raise ValueError(
                f"seed must be from 0 to 2^32 - seeds, got {self.seed} and "
                f"{self.seeds}."
            )

    def _check_monitor(self) -> None:
        """Refuses evaluations that would not come, or not be kept."""
        if self.monitor is None:
            return
        is_kept = self.monitor.best_by is not None
        per = "updates_per_checkpoint" if is_kept else "updates_per_call"
        if self.monitor.every % getattr(self, per):
            raise ValueError(
                f"monitor.every must be a multiple of {per}"
                + (", so that what is best was saved" if is_kept else "")
                + f", got {self.monitor.every} and {getattr(self, per)}."
            )

    def _check_stream(self) -> None:
        """Refuses streams that would not go as the config says."""
        if self.stream.resident is None:
            return
        per_page = self.stream.updates_per_page
        if per_page % self.updates_per_call:
            raise ValueError(
                "stream.updates_per_page must be a multiple of updates_per_call, got "
                f"{per_page} and {self.updates_per_call}."
            )
        if not isinstance(self.learner, CloningConfig | ForecastConfig):
            raise ValueError(
                f"{self.learner.name} plays on while pages are exchanged, and would "
                "find itself in the middle of another scenario; stream for bc and "
                "wayformer, or leave stream.resident out."
            )

    def _check_discounts(self) -> None:
        """Refuses discounts under which other policies than meant become the best."""
        shaping, settled = self.task.shaping, getattr(self.task, "settled_at", ())
        is_slope = isinstance(self.learner, AnalyticConfig)  # which adds up all rewards
        discount = 1.0 if is_slope else getattr(self.learner, "discount", None)
        if shaping is not None and discount not in (None, shaping.discount):
            what = "1 for apg" if is_slope else "learner.discount"
            raise ValueError(
                f"task.shaping.discount must be {what}, or other policies become the "
                f"best, got {shaping.discount} and {discount}."
            )
        if settled and is_slope:
            raise ValueError(
                "apg adds up the rewards of whole episodes, so nothing settles one; "
                "leave task.settled_at out."
            )

    def _check_opponents(self) -> None:
        """Refuses opponents who would not be met as the config says."""
        mix, num_pasts = self.opponents, getattr(self.learner, "num_pasts", 0)
        if mix != OpponentsConfig():
            if not isinstance(self.task, tasks.SelfPlayConfig):
                raise ValueError("opponents are met in self-play; set task.name.")
            if self.task.sim_agent != "playback":
                raise ValueError(
                    "opponents say who drives the others, so task.sim_agent must be "
                    f"playback, got {self.task.sim_agent}."
                )
        if bool(mix.past) != bool(num_pasts):
            raise ValueError(
                "past selves are kept and met, or neither: opponents.past and "
                f"learner.num_pasts (of ppo) must both be 0 or neither, got {mix.past} "
                f"and {num_pasts}."
            )

    @property
    def source(self) -> loader.Source:
        """Where the scenarios to train on come from."""
        return loader.Source(
            path=self.data,
            split=self.split,
            test_share=self.test_share,
            query=self.query,
            max_scenarios=self.max_scenarios,
        )


def environment(experiment: Experiment, sim_agent: str | None = None) -> Environment:
    """Builds the task of an experiment.

    Args:
        experiment: what to build.
        sim_agent: drives all others, instead of the one of the experiment.

    Raises:
        ValueError: if a name is unknown.
    """
    return tasks.build(
        experiment.task,
        dynamics.build(experiment.dynamics),
        observations.build(experiment.observation),
        None if sim_agent is None else sim_agents.build(sim_agent),
    )


def agent(experiment: Experiment, env: Environment, bank: Bank) -> Agent:
    """Builds the agent of an experiment.

    Args:
        experiment: what to build.
        env: the task whose observations it sees.
        bank: of one device; only its shapes are read.

    Raises:
        ValueError: if network, learner and task do not fit together.
    """

    def first_observation(bank: Bank):
        state = env.reset(bank, jnp.int32(0), jax.random.key(0))
        return actors.first(env, env.observe(bank, state))

    observation = jax.eval_shape(first_observation, bank)
    spec, kind = actors.action_spec(env), learners.kind_of(experiment.learner)
    return agents.build(experiment.agent, observation, spec, kind)


def learner(experiment: Experiment, env: Environment, agent: Agent) -> Learner:
    """Builds the learner of an experiment, of one seed.

    Args:
        experiment: what to build.
        env: where nobody is met but sim agents that do not learn.
        agent: who learns.

    Raises:
        ValueError: if its parts do not fit together.
    """
    env_of = _environment_of(experiment, env, agent)
    return learners.build(experiment.learner, agent, env_of, _sample(experiment))


def _environment_of(
    experiment: Experiment, env: Environment, agent: Agent
) -> EnvironmentOf:
    """Returns the task given the past selves that are kept."""
    task, mix = experiment.task, experiment.opponents
    if not isinstance(task, tasks.SelfPlayConfig) or mix == OpponentsConfig():
        return lambda past: env
    moves = dynamics.build(experiment.dynamics)
    observer = observations.build(experiment.observation)
    controls = moving_vehicles(task.controlled)

    def env_of(pasts: Pasts | tuple[()]) -> Environment:
        past = None
        if isinstance(pasts, Pasts):
            past = opponents.past_self(agent, pasts, moves, observer)
        others = opponents.others(controls, mix, past)
        return tasks.build(task, moves, observer, others, opponents.team(controls, mix))

    return env_of


def _sample(experiment: Experiment) -> Draw:
    """Returns what draws examples for learners from logs."""
    moves = dynamics.build(experiment.dynamics)
    observer = observations.build(experiment.observation)
    if isinstance(experiment.learner, ForecastConfig):
        return futures(moves, observer, experiment.agent.trajectory.num_steps)
    return demonstrations(moves, observer)


def over_seeds(experiment: Experiment) -> Callable[[Program], Program]:
    """Returns what makes a run of all seeds from that of one."""
    if experiment.seeds == 1:
        return lambda run: run
    return seeds.in_turn if experiment.seeds_in_turn else seeds.side_by_side


def keys(experiment: Experiment) -> Key[Array, "*seeds"]:
    """Returns the key of each seed; a lone one has no axis."""
    first = experiment.seed
    if experiment.seeds == 1:
        return jax.random.key(first)
    return jnp.stack([jax.random.key(first + i) for i in range(experiment.seeds)])
