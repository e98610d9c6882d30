"""Builds a learner from its config."""

from ..agents.base import Agent
from ..agents.build import Kind
from ..sim.env.base import Environment
from ..sim.env.demonstrations import Sample
from . import optim
from .apg import AnalyticConfig, analytic_policy_gradient
from .base import Learner
from .bc import CloningConfig, behavior_cloning
from .dqn import DQNConfig, double_dqn

LearnerConfig = CloningConfig | DQNConfig | AnalyticConfig


def kind_of(config: LearnerConfig) -> Kind:
    """Returns what a learner asks of its agent."""
    return "action_values" if isinstance(config, DQNConfig) else "policy"


def build(
    config: LearnerConfig, agent: Agent, env: Environment, sample: Sample
) -> Learner:
    """Builds the learner of a config.

    Args:
        config: what to build; its type says which.
        agent: the policy it improves.
        env: where it acts.
        sample: draws one demonstration from the bank.

    Raises:
        ValueError: if learner, agent and task do not fit together.
    """
    optimizer = optim.adam(config)
    match config:
        case CloningConfig():
            return behavior_cloning(agent, sample, optimizer, config)
        case DQNConfig():
            return double_dqn(agent, env, sample, optimizer, config)
        case AnalyticConfig():
            return analytic_policy_gradient(env, agent, optimizer, config)
