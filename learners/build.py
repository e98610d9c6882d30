"""Builds a learner from its config."""

from ..agents.base import Agent
from ..agents.build import Kind
from ..sim.env.base import Environment
from . import optim
from .apg import AnalyticConfig, analytic_policy_gradient
from .base import Learner
from .bc import CloningConfig, Draw, behavior_cloning
from .forecasting import ForecastConfig, forecasting

LearnerConfig = CloningConfig | AnalyticConfig | ForecastConfig


def kind_of(config: LearnerConfig) -> Kind:
    """Returns what a learner asks of its agent."""
    return "trajectories" if isinstance(config, ForecastConfig) else "policy"


def build(
    config: LearnerConfig, agent: Agent, env: Environment, sample: Draw
) -> Learner:
    """Builds the learner of a config.

    Args:
        config: what to build; its type says which.
        agent: the policy it improves.
        env: where it acts.
        sample: draws what it imitates from the bank, one at a time.

    Raises:
        ValueError: if learner, agent and task do not fit together.
    """
    optimizer = optim.adam(config)
    match config:
        case CloningConfig():
            return behavior_cloning(agent, sample, optimizer, config)
        case AnalyticConfig():
            return analytic_policy_gradient(env, agent, optimizer, config)
        case ForecastConfig():
            return forecasting(agent, sample, optimizer, config)
