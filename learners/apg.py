"""Learns by analytic policy gradients: differentiates the reward through the simulator.

No peer needs fewer samples where the reward is smooth; where it is a flag, such as
whether boxes overlap, its gradient is zero and says nothing.
"""

import dataclasses
import functools
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from ..agents.base import Agent, Params
from ..sim import ranges
from ..sim.dynamics.base import Continuous
from ..sim.env.base import Environment
from . import acting, actors, losses, optim, strata
from .acting import Cast, World
from .base import Bank, Learner, Metrics, TrainState


@dataclasses.dataclass(frozen=True, kw_only=True)
class AnalyticConfig(optim.OptimizerConfig):
    """How far gradients reach, and in how many worlds."""

    name: Literal["apg"] = "apg"
    num_worlds: int = 64  # over all devices
    steps_per_update: int = 16  # through which an action's consequences are followed
    strata: int = 8  # equal parts of the worlds; the devices' number must divide it

    def __post_init__(self) -> None:
        """Checks the counts, and the fields of the optimizer.

        Raises:
            ValueError: if strata do not divide the worlds, or a field is out of range.
        """
        super().__post_init__()
        strata.check(self.strata, num_worlds=self.num_worlds)
        ranges.require_at_least(self, steps_per_update=1)

    @property
    def num_steps(self) -> int:
        """How many steps of worlds an update plays."""
        return self.num_worlds * self.steps_per_update


@dataclasses.dataclass(frozen=True, kw_only=True)
class Setting:
    """Who learns where, and how."""

    cast: Cast
    optimizer: optim.Optimizer
    config: AnalyticConfig


def analytic_policy_gradient(
    env: Environment, agent: Agent, optimizer: optim.Optimizer, config: AnalyticConfig
) -> Learner:
    """Makes a learner that follows the slope of the reward itself.

    With the simulator s' = f(s, a), the policy a = pi(s) of its most likely action and
    windows of H steps from states where the last windows ended:

        loss = -sum_t r(s_t+1) / H,    d s_t+1 / d theta = f_s d s_t / d theta
                                       + f_a (pi_theta + pi_s d s_t / d theta)

    over all worlds together. States at the start of a window count as constants.

    Args:
        env: whose reward and dynamics are smooth.
        agent: whose actions are continuous.
        optimizer: takes the steps.
        config: the windows.

    Raises:
        ValueError: if actions are numbered, as those have no slope.
    """
    if not isinstance(actors.action_spec(env), Continuous):
        raise ValueError(
            "apg needs continuous actions, such as dynamics=bicycle; these are numbered"
        )
    cast = Cast(env, agent, acting.likeliest)
    setting = Setting(cast=cast, optimizer=optimizer, config=config)
    return Learner(
        init=functools.partial(_init, setting),
        act=_act,
        learn=functools.partial(_learn, setting),
    )


def _init(
    setting: Setting, key: Key[Array, ""], bank: Bank, axis_name: str
) -> TrainState:
    config, cast = setting.config, setting.cast
    key, params_key, worlds_key = jax.random.split(key, 3)
    params = cast.agent.init(params_key)
    share = strata.share(config.strata, axis_name)
    per_stratum = config.num_worlds // config.strata
    return TrainState(
        params=params,
        opt_state=setting.optimizer.transformation.init(params),
        step=jnp.zeros((), jnp.int32),
        key=key,
        worlds=acting.start(cast, bank, share, worlds_key, per_stratum),
    )


def _act(
    train_state: TrainState, bank: Bank, axis_name: str
) -> tuple[TrainState, tuple[()]]:
    del bank, axis_name  # acting is part of what is differentiated
    return train_state, ()


def _learn(
    setting: Setting,
    train_state: TrainState,
    experience: tuple[()],
    bank: Bank,
    axis_name: str,
) -> tuple[TrainState, Metrics]:
    del experience
    cast, num_steps = setting.cast, setting.config.steps_per_update
    key, drive_key = jax.random.split(train_state.key)
    share = strata.share(setting.config.strata, axis_name)

    def loss(params: Params, worlds: World) -> tuple[Metrics, World]:
        worlds, steps = acting.drive(
            cast, params, bank, share, worlds, drive_key, num_steps
        )
        mask = steps.mask.astype(jnp.float32)
        return {"loss": losses.weighted(-steps.reward, mask)}, worlds

    train_state, metrics, worlds = optim.descend(
        setting.optimizer,
        train_state.replace(key=key),
        axis_name,
        loss,
        train_state.worlds,
    )
    return train_state.replace(worlds=worlds), metrics
