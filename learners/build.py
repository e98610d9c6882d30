"""Builds a learner from its config."""

from ..agents.base import Agent
from ..sim.env.demonstrations import Sample
from . import bc, optim
from .base import Learner

LearnerConfig = bc.CloningConfig


def build(config: LearnerConfig, agent: Agent, sample: Sample) -> Learner:
    """Builds the learner of a config.

    Args:
        config: what to build; its type says which.
        agent: the policy it improves.
        sample: draws one demonstration from the bank.
    """
    optimizer = optim.adam(config)
    return bc.behavior_cloning(agent, sample, optimizer, config)
