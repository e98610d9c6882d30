"""Learns to forecast: makes the logged future likely among several trajectories."""

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..agents.base import Agent, Params
from ..agents.plan import Planned
from ..agents.trajectories import Trajectories
from ..sim.env.futures import Future, Sample
from . import bc, losses, optim, strata
from .base import Learner, Metrics


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForecastConfig(optim.OptimizerConfig):
    """How an agent learns where it may go."""

    name: Literal["wayformer"] = "wayformer"
    batch_size: int = 256  # futures an update, over all devices
    strata: int = 8  # equal parts of a batch; the number of devices must divide it

    def __post_init__(self) -> None:
        """Checks the batch, and the fields of the optimizer.

        Raises:
            ValueError: if strata do not divide the batch, or a field is out of range.
        """
        super().__post_init__()
        strata.check(self.strata, batch_size=self.batch_size)

    @property
    def num_steps(self) -> int:
        """How many futures an update sees."""
        return self.batch_size


def forecasting(
    agent: Agent, sample: Sample, optimizer: optim.Optimizer, config: ForecastConfig
) -> Learner:
    """Makes a learner that trains the trajectory nearest to the logged one.

    The loss is the mean of `terms` over futures of which the log holds a step, of all
    devices together. Its metrics are those terms, and the optimizer's.
    """

    def loss(params: Params, batch: Future) -> tuple[Metrics, None]:
        return forecast_metrics(agent, params, batch), None

    per_stratum = config.batch_size // config.strata
    return bc.from_logs(agent, sample, optimizer, config.strata, per_stratum, loss)


def forecast_metrics(agent: Agent, params: Params, batch: Future) -> Metrics:
    """Returns the means of `terms`; a future without any step has no weight.

    Raises:
        TypeError: while it is traced, if the agent forecasts nothing.
    """

    def of_one(future: Future) -> dict[str, Array]:
        _, output = agent.step(params, agent.memory(), future.observation)
        if not isinstance(output.policy, Planned):
            raise TypeError(
                "a learner of forecasts needs an agent that plans, got the policy "
                f"{type(output.policy).__name__}."
            )
        return terms(output.policy.forecast, future.poses, future.mask)

    found = jax.vmap(of_one)(batch)
    weight = jnp.any(batch.mask, axis=1).astype(jnp.float32)
    return {name: losses.weighted(term, weight) for name, term in found.items()}


def terms(
    forecast: Trajectories,
    poses: Float[Array, "steps 3"],
    mask: Bool[Array, " steps"],
) -> dict[str, Float[Array, ""]]:
    """Compares a forecast with what came.

    With the trajectory k nearest to the future y, by mean distance of its steps
    (Nayakanti et al. 2022, section 3):

        loss = -log p(k) - sum_t log N(y_t; mean_kt, scale_kt)

    over the steps t that are there.

    Returns:
        `loss` [nats]; `min_ade` and `ade` [m], mean distances to the nearest of all
        trajectories and to the most likely; `accuracy`, whether those are the same.
    """
    poses = jnp.where(mask[:, None], poses, 0.0)  # else NaN there spoils the gradient
    distance = forecast.distance(poses, mask)
    nearest, likeliest = jnp.argmin(distance), jnp.argmax(forecast.logits)
    step_log_prob = forecast.step_log_prob(poses)[nearest]
    log_prob = jnp.sum(jnp.where(mask, step_log_prob, 0.0))
    return {
        "loss": -jax.nn.log_softmax(forecast.logits)[nearest] - log_prob,
        "min_ade": distance[nearest],
        "ade": distance[likeliest],
        "accuracy": (nearest == likeliest).astype(jnp.float32),
    }
