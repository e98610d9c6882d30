"""Builds a small one of every learner, with the bank that it learns from."""

import functools
from collections.abc import Callable

import optax

from drivetrain.learners import bc, optim
from drivetrain.learners.base import Bank, Learner
from drivetrain.learners.ppo import ppo
from tests.learners import (
    apg_test,
    crowd,
    dqn_test,
    forecasting_test,
    ppo_test,
    probes,
    toy,
)


def cloning() -> Learner:
    config = bc.CloningConfig(batch_size=16, learning_rate=1e-2)
    sample = toy.sampler(toy.sign)
    return bc.behavior_cloning(toy.linear_agent(), sample, optim.adam(config), config)


def forecasting() -> Learner:
    """Forecasts, by plain steps: Adam's are long where a slope is but rounding."""
    rate = 1e-2
    schedule = optax.constant_schedule(rate)
    optimizer = optim.Optimizer(
        transformation=optax.sgd(schedule), learning_rate=schedule
    )
    return forecasting_test.learner_of(forecasting_test.forecaster(), optimizer)


def valuing() -> Learner:
    """Learns values, imitation included."""
    settings = dqn_test.config(
        strata=8, imitation_weight=0.5, batch_size=32, num_worlds=16
    )
    return dqn_test.learner(probes.VALUE, settings, dqn_test.expert)


def playing() -> Learner:
    """Plays with many actors that remember, on seats."""
    config, env = ppo_test.CONFIG, crowd.environment(max_actors=4)
    optimizer = optim.adam(config)
    return ppo(ppo_test.GRU, lambda past: env, ppo_test.no_sample, optimizer, config)


# Of the number of devices, the bank.
LEARNERS: dict[str, tuple[Callable[[], Learner], Callable[[int], Bank]]] = {
    "bc": (cloning, toy.bank),
    "wayformer": (forecasting, toy.bank),
    "dqn": (valuing, probes.bank),
    "ppo": (playing, probes.bank),
    "apg": (functools.partial(apg_test.learner, spread=0.2), probes.bank),
}
