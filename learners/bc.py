"""Learns by behavior cloning: makes the expert's actions likely."""

import dataclasses
import math
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from ..agents.base import Agent, Params
from ..agents.distributions import Categorical
from ..agents.factored import FactoredCategorical
from ..sim.data.stratum import whole
from ..sim.env.demonstrations import Demonstration, Sample
from . import balance, losses, optim, strata
from .base import Bank, Learner, Metrics, TrainState


@dataclasses.dataclass(frozen=True, kw_only=True)
class CloningConfig(optim.OptimizerConfig):
    """How an agent imitates."""

    name: Literal["bc"] = "bc"
    batch_size: int = 256  # demonstrations an update, over all devices
    strata: int = 8  # equal parts of a batch; the number of devices must divide it
    label_smoothing: float = 0.0  # share of the probability that all actions have
    class_balance: float = 0.0  # 1: each action weighs the same in all, 0: as shown

    def __post_init__(self) -> None:
        """Checks the batch, and the fields of the optimizer.

        Raises:
            ValueError: if strata do not divide the batch, or a field is out of range.
        """
        super().__post_init__()
        strata.check(self.strata, batch_size=self.batch_size)
        for name in ("label_smoothing", "class_balance"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(
                    f"{name} must be from 0 to 1, got {getattr(self, name)}."
                )

    @property
    def num_steps(self) -> int:
        """How many demonstrations an update sees."""
        return self.batch_size


def behavior_cloning(
    agent: Agent, sample: Sample, optimizer: optim.Optimizer, config: CloningConfig
) -> Learner:
    """Makes a learner that maximizes the log-likelihood of the expert's actions.

    With demonstrations (o, a) of weight w (Gulino et al. 2023, A.2; w is ours):

        loss = -sum_i w_i log p(a_i | o_i) / sum_i w_i

    over the batches of all devices together. With `class_balance`, w is also that of
    `balance.weights`; with `label_smoothing`, the likelihood that of `losses.surprise`.
    Its metrics are the loss, `accuracy` or
    `absolute_error` (`losses.imitation_error`), and the optimizer's.
    """

    def loss(params: Params, batch: Demonstration) -> tuple[Metrics, None]:
        return imitation(agent, params, batch, config.label_smoothing), None

    def init(key: Key[Array, ""], bank: Bank, axis_name: str) -> TrainState:
        del axis_name
        key, params_key = jax.random.split(key)
        params = agent.init(params_key)
        kept = ()
        if config.class_balance:
            kept = balance.begin(_num_actions(agent, sample, bank))
        return TrainState(
            params=params,
            opt_state=optimizer.transformation.init(params),
            step=jnp.zeros((), jnp.int32),
            key=key,
            kept=kept,
        )

    def act(
        train_state: TrainState, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Demonstration]:
        key, batch_key = jax.random.split(train_state.key)
        share = strata.share(config.strata, axis_name)
        per_stratum = config.batch_size // config.strata
        batch = draw(sample, bank, share, batch_key, per_stratum)
        return train_state.replace(key=key), batch

    def learn(
        train_state: TrainState, batch: Demonstration, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        del bank
        if config.class_balance:
            seen = balance.see(train_state.kept, batch.action, batch.weight, axis_name)
            rare = balance.weights(seen, batch.action, config.class_balance)
            batch = batch.replace(weight=batch.weight * rare)
            train_state = train_state.replace(kept=seen)
        train_state, metrics, _ = optim.descend(
            optimizer, train_state, axis_name, loss, batch
        )
        return train_state, metrics

    return Learner(init=init, act=act, learn=learn)


def draw(
    sample: Sample,
    bank: Bank,
    share: strata.Share,
    key: Key[Array, ""],
    per_stratum: int,
) -> Demonstration:
    """Draws demonstrations, as many of each stratum, with a leading axis of all."""

    def of_stratum(stratum, key: Key[Array, ""]) -> Demonstration:
        keys = jax.random.split(key, per_stratum)
        return jax.vmap(sample, in_axes=(None, None, 0))(bank, stratum, keys)

    return strata.merge(jax.vmap(of_stratum)(share.stratum, share.keys(key)))


def _num_actions(agent: Agent, sample: Sample, bank: Bank) -> int:
    """Returns how many numbered actions there are to choose among."""

    def policy(key: Key[Array, ""]):
        shown = sample(bank, whole(), key)
        return agent.step(agent.init(key), agent.memory(), shown.observation)[1].policy

    found = jax.eval_shape(policy, jax.random.key(0))
    match found:
        case Categorical(logits=logits):
            return len(logits)
        case FactoredCategorical(logits=factors):
            return math.prod(len(logits) for logits in factors)
        case _:
            raise ValueError(
                "class_balance needs numbered actions, such as those of "
                "dynamics=bicycle_discrete"
            )


def imitation(
    agent: Agent, params: Params, batch: Demonstration, smoothing: float = 0.0
) -> Metrics:
    """Returns how unlikely the expert's actions are, `loss`, and how far off.

    Each demonstration is met without memory of another.
    """

    def imitate(demonstration: Demonstration) -> dict[str, Array]:
        _, output = agent.step(params, agent.memory(), demonstration.observation)
        error = losses.imitation_error(output.policy, demonstration.action)
        return {
            "loss": losses.surprise(output.policy, demonstration.action, smoothing),
            **error,
        }

    terms = jax.vmap(imitate)(batch)
    return {name: losses.weighted(term, batch.weight) for name, term in terms.items()}
