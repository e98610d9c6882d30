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

    def __post_init__(self) -> None:
        """Checks the name and the batch, and the fields of the optimizer.

        Raises:
            ValueError: if the name is unknown, the batch is empty, or the optimizer's
                fields are out of range.
        """
        super().__post_init__()
        if self.name not in KNOWN:
            raise names.unknown("learner", self.name, KNOWN)
        if self.batch_size < 1:
            raise ValueError(f"batch_size must be at least 1, got {self.batch_size}.")


def build(config: LearnerConfig, agent: Agent, sample: Sample) -> Learner:
    """Builds the learner that the config names.

    Args:
        config: what to build.
        agent: the policy it improves.
        sample: draws one demonstration from the bank.
    """
    optimizer = optim.adam(config)
    return bc.behavior_cloning(agent, sample, optimizer, config.batch_size)
