"""Builds a learner from its config."""

from ..agents.base import Agent
from ..agents.build import Kind
from . import optim
from .apg import AnalyticConfig, analytic_policy_gradient
from .base import Learner
from .bc import CloningConfig, Draw, behavior_cloning
from .dqn import DQNConfig, double_dqn
from .forecasting import ForecastConfig, forecasting
from .ppo import EnvironmentOf, PPOConfig, ppo

LearnerConfig = CloningConfig | ForecastConfig | DQNConfig | PPOConfig | AnalyticConfig


def kind_of(config: LearnerConfig) -> Kind:
    """Returns what a learner asks of its agent."""
    match config:
        case DQNConfig():
            return "action_values"
        case PPOConfig():
            return "actor_critic"
        case ForecastConfig():
            return "trajectories"
        case CloningConfig() | AnalyticConfig():
            return "policy"


def build(
    config: LearnerConfig, agent: Agent, env_of: EnvironmentOf, sample: Draw
) -> Learner:
    """Builds the learner of a config.

    Args:
        config: what to build; its type says which.
        agent: the policy it improves.
        env_of: where it acts, given the past selves that are kept, if any are met.
        sample: draws what it imitates from the bank, one at a time.

    Raises:
        ValueError: if learner, agent and task do not fit together.
    """
    optimizer, env = optim.adam(config), env_of(())
    match config:
        case CloningConfig():
            return behavior_cloning(agent, sample, optimizer, config)
        case DQNConfig():
            return double_dqn(agent, env, sample, optimizer, config)
        case PPOConfig():
            return ppo(agent, env_of, sample, optimizer, config)
        case AnalyticConfig():
            return analytic_policy_gradient(env, agent, optimizer, config)
        case ForecastConfig():
            return forecasting(agent, sample, optimizer, config)
