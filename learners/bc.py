"""Learns by behavior cloning: makes the expert's actions likely."""

import dataclasses
import math
from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key, PRNGKeyArray, PyTree

from ..agents.base import Agent, Params
from ..agents.distributions import Categorical
from ..agents.factored import FactoredCategorical
from ..sim import ranges
from ..sim.data.stratum import Stratum, whole
from ..sim.env.demonstrations import Demonstration, Sample
from . import balance, losses, optim, strata
from .base import Bank, Experience, Learner, Metrics, TrainState

Draw = Callable[[Bank, Stratum, PRNGKeyArray], PyTree]  # of one example of any kind


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
        ranges.require_share(self, "label_smoothing", "class_balance")

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

    Raises:
        ValueError: if the agent remembers.
    """

    def loss(params: Params, batch: Demonstration) -> tuple[Metrics, None]:
        return imitation(agent, params, batch, config.label_smoothing), None

    require_no_memory(agent)
    per_stratum = config.batch_size // config.strata
    learner = from_logs(agent, sample, optimizer, config.strata, per_stratum, loss)
    if not config.class_balance:
        return learner
    return _balanced(learner, agent, sample, config.class_balance)


def require_no_memory(agent: Agent) -> None:
    """Refuses an agent that would learn from single steps what it is to do in a row.

    Raises:
        ValueError: if the agent remembers.
    """
    if agent.remembers:
        raise ValueError(
            "demonstrations are single steps, from which an agent with memory learns "
            "nothing of what it remembers; set agent.memory_width=0, or "
            "learner.imitation_weight=0."
        )


def _balanced(
    learner: Learner, agent: Agent, sample: Sample, exponent: float
) -> Learner:
    """Makes a learner for which demonstrations weigh more the rarer their actions."""

    def init(key: Key[Array, ""], bank: Bank, axis_name: str) -> TrainState:
        num_actions = _num_actions(agent, sample, bank)
        begun = learner.init(key, bank, axis_name)
        return begun.replace(kept=balance.begin(num_actions))

    def learn(
        train_state: TrainState, batch: Demonstration, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        seen = balance.see(train_state.kept, batch.action, batch.weight, axis_name)
        rare = balance.weights(seen, batch.action, exponent)
        batch = batch.replace(weight=batch.weight * rare)
        return learner.learn(train_state.replace(kept=seen), batch, bank, axis_name)

    return Learner(init=init, act=learner.act, learn=learn)


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


def from_logs(
    agent: Agent,
    sample: Draw,
    optimizer: optim.Optimizer,
    num_strata: int,
    per_stratum: int,
    loss: optim.Loss,
) -> Learner:
    """Makes a learner from logs alone: it draws a batch where others act.

    Args:
        agent: what is trained.
        sample: draws one example from the bank.
        optimizer: takes the steps.
        num_strata: over all devices.
        per_stratum: how many examples of each are in a batch.
        loss: of the parameters and a batch.
    """

    def init(key: Key[Array, ""], bank: Bank, axis_name: str) -> TrainState:
        del bank, axis_name
        key, params_key = jax.random.split(key)
        params = agent.init(params_key)
        return TrainState(
            params=params,
            opt_state=optimizer.transformation.init(params),
            step=jnp.zeros((), jnp.int32),
            key=key,
        )

    def act(
        train_state: TrainState, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Experience]:
        key, batch_key = jax.random.split(train_state.key)
        share = strata.share(num_strata, axis_name)
        batch = draw(sample, bank, share, batch_key, per_stratum)
        return train_state.replace(key=key), batch

    def learn(
        train_state: TrainState, batch: Experience, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        del bank
        train_state, metrics, _ = optim.descend(
            optimizer, train_state, axis_name, loss, batch
        )
        return train_state, metrics

    return Learner(init=init, act=act, learn=learn)


def draw(
    sample: Draw,
    bank: Bank,
    share: strata.Share,
    key: Key[Array, ""],
    per_stratum: int,
) -> PyTree:
    """Draws examples, as many of each stratum, with a leading axis of all."""

    def of_stratum(stratum: Stratum, key: Key[Array, ""]) -> PyTree:
        keys = jax.random.split(key, per_stratum)
        return jax.vmap(sample, in_axes=(None, None, 0))(bank, stratum, keys)

    return strata.merge(jax.vmap(of_stratum)(share.stratum, share.keys(key)))


def imitation(
    agent: Agent, params: Params, batch: Demonstration, smoothing: float = 0.0
) -> Metrics:
    """Returns how unlikely the expert's actions are, `loss`, and how far off.

    Each demonstration is met without memory of another.
    """

    def imitate(demonstration: Demonstration) -> dict[str, Array]:
        _, output = agent.step(params, agent.memory(), demonstration.observation)
        error = losses.imitation_error(output.policy, demonstration.action)
        loss = losses.surprise(output.policy, demonstration.action, smoothing)
        return {"loss": loss, **error}

    terms = jax.vmap(imitate)(batch)
    return {name: losses.weighted(term, batch.weight) for name, term in terms.items()}
