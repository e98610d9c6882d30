"""Builds a learner from its config."""

import dataclasses

from ..agents.base import Agent
from ..sim import names
from ..sim.env.demonstrations import Sample
from . import bc, optim
from .base import Learner

KNOWN = ("bc",)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearnerConfig(optim.OptimizerConfig):
    """Which algorithm, on what batches, and the fields of its optimizer."""

    name: str = "bc"
    batch_size: int = 256  # over all devices


def build(config: LearnerConfig, agent: Agent, sample: Sample) -> Learner:
    """Builds the learner that the config names.

    Args:
        config: what to build.
        agent: the policy it improves.
        sample: draws one demonstration from the bank.

    Raises:
        ValueError: if the name is not known or the batch is empty.
    """
    if config.batch_size < 1:
        raise ValueError(f"batch_size must be at least 1, got {config.batch_size}.")
    optimizer = optim.adam(config)
    match config.name:
        case "bc":
            return bc.behavior_cloning(agent, sample, optimizer, config.batch_size)
        case _:
            raise names.unknown("learner", config.name, KNOWN)
