"""Builds a task from its config."""

import dataclasses
from collections.abc import Collection
from dataclasses import field
from typing import Literal

from .. import names, rewards
from ..dynamics.base import Dynamics
from ..metrics.base import Metric
from ..metrics.build import METRICS
from ..metrics.smooth import SMOOTH_COLLISION, SMOOTH_OFFROAD
from ..observations.base import Observer
from ..rewards import Reward
from ..sim_agents import build as sim_agents
from ..sim_agents.base import SimAgent
from .base import Controls, Environment, Team
from .controlled import MovingConfig, moving_vehicles
from .multi_agent import MultiAgentConfig, multi_agent
from .planning import planning
from .starts import StartConfig

# A preset by name, or the weights of metrics.
RewardConfig = str | dict[str, float]
POTENTIALS = {"goal": rewards.nearness_to_goal, "log": rewards.nearness_to_log}
SMOOTH = (SMOOTH_COLLISION, SMOOTH_OFFROAD)  # measured where a reward asks for them


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShapingConfig:
    """Pays for coming nearer, and takes it back for going away (`rewards.shaped`)."""

    towards: Literal["goal", "log"] = "goal"  # where the log ends, or is at the time
    weight: float = 0.1  # of a metre
    discount: float = 0.99  # the learner's, without which best policies may change


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """The ego drives."""

    name: Literal["planning"] = "planning"
    sim_agent: str = "playback"  # drives all others in training
    reward: RewardConfig = "sparse"
    shaping: ShapingConfig | None = None
    starts: StartConfig = field(default_factory=StartConfig)
    settled_at: tuple[str, ...] = ()  # metrics that settle what came before

    def __post_init__(self) -> None:
        """Checks the names, and the ranges of shaping.

        Raises:
            ValueError: if a sim agent, a preset or a metric is unknown, or a number of
                shaping is out of range.
        """
        sim_agents.build(self.sim_agent)
        reward_of(self.reward, self.shaping)
        for metric in self.settled_at:
            _require_known(metric, METRICS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SelfPlayConfig:
    """All vehicles that move drive, until they reach their goal or collide (N 4.1)."""

    name: Literal["self_play"] = "self_play"
    sim_agent: str = "playback"  # drives whoever is not controlled
    reward: RewardConfig = "nocturne"
    shaping: ShapingConfig | None = None
    starts: StartConfig = field(default_factory=StartConfig)
    controlled: MovingConfig = field(default_factory=MovingConfig)
    remove_at: tuple[str, ...] = ("goal", "collision")  # metrics that end a part

    def __post_init__(self) -> None:
        """Checks the names, and the ranges of shaping.

        Raises:
            ValueError: if a sim agent, a preset or a metric is unknown, or a number of
                shaping is out of range.
        """
        sim_agents.build(self.sim_agent)
        reward_of(self.reward, self.shaping)
        for metric in self.remove_at:
            _require_known(metric, METRICS)


TaskConfig = PlanningConfig | SelfPlayConfig


def build(
    config: TaskConfig,
    dynamics: Dynamics,
    observer: Observer,
    sim_agent: SimAgent | None = None,
    controls: Controls | None = None,
) -> Environment:
    """Builds the environment of a config.

    Args:
        config: the task.
        dynamics: of whoever is controlled.
        observer: what they see.
        sim_agent: drives all others, instead of the one that the config names.
        controls: in self-play, who is controlled, instead of all that the config says;
            others of them are removed all the same.
    """
    others = sim_agent or sim_agents.build(config.sim_agent)
    is_planning = isinstance(config, PlanningConfig)
    ends = config.settled_at if is_planning else config.remove_at
    reward, metrics = reward_of(config.reward, config.shaping, ends)
    if is_planning:
        return planning(
            dynamics, others, observer, reward, metrics, config.starts, ends
        )
    whole = moving_vehicles(config.controlled)
    return multi_agent(
        (Team(dynamics, controls or whole),),
        others,
        observer,
        reward,
        metrics,
        MultiAgentConfig(
            remove_at=config.remove_at,
            joins_later=False,
            max_actors=config.controlled.max_objects,
            starts=config.starts,
        ),
        rivals=whole,
    )


def reward_of(
    config: RewardConfig,
    shaping: ShapingConfig | None = None,
    ends: Collection[str] = (),
) -> tuple[Reward, tuple[Metric, ...]]:
    """Returns a reward, and the metrics to measure for it and for the record.

    Args:
        config: the reward without shaping.
        shaping: what is paid besides.
        ends: metrics that end or settle the task where they are positive.

    Raises:
        ValueError: if a preset or a metric is unknown, or a number of shaping is out of
            range.
    """
    reward, metrics = _bare(config)
    if shaping is None:
        return reward, metrics
    potential = POTENTIALS[shaping.towards]
    shaped = rewards.shaped(reward, potential, shaping.weight, shaping.discount, ends)
    return shaped, metrics


def _bare(config: RewardConfig) -> tuple[Reward, tuple[Metric, ...]]:
    """Returns a reward without shaping, and what it measures."""
    if config == "nocturne":
        return rewards.nocturne_dense(), METRICS
    if isinstance(config, str):
        if config != "sparse":
            raise names.unknown("reward", config, ("sparse", "nocturne"))
        return rewards.weighted(rewards.SPARSE), METRICS
    for metric in config:
        _require_known(metric, (*METRICS, *SMOOTH))
    wanted = tuple(metric for metric in SMOOTH if metric.name in config)
    return rewards.weighted(config), (*METRICS, *wanted)


def _require_known(name: str, metrics: tuple[Metric, ...]) -> None:
    known = [metric.name for metric in metrics]
    if name not in known:
        raise names.unknown("metric", name, known)
