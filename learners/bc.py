"""Learns by behavior cloning: makes the expert's actions likely."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from ..agents.base import Agent, Params
from ..sim.env.demonstrations import Demonstration, Sample
from . import losses, optim
from .base import Bank, Learner, Metrics, TrainState


def behavior_cloning(
    agent: Agent, sample: Sample, optimizer: optim.Optimizer, batch_size: int
) -> Learner:
    """Makes a learner that maximizes the log-likelihood of the expert's actions.

    With demonstrations (o, a) of weight w (Gulino et al. 2023, A.2; w is ours):

        loss = -sum_i w_i log p(a_i | o_i) / sum_i w_i

    over the batches of all devices together. Its metrics are the loss, `accuracy` or
    `absolute_error` (`losses.imitation_error`), `total_weight`, and the optimizer's.

    Args:
        agent: the policy.
        sample: draws one demonstration.
        optimizer: takes the steps.
        batch_size: demonstrations per update, over all devices.

    Returns:
        The learner; its `update` raises ValueError, while it is traced, if the number
        of devices does not divide the batch.
    """

    def local_sums(params: Params, batch: Demonstration) -> tuple[Array, Metrics]:
        def imitate(demonstration: Demonstration) -> Metrics:
            distribution = agent.distribution(params, demonstration.observation)
            error = losses.imitation_error(distribution, demonstration.action)
            return {"loss": -distribution.log_prob(demonstration.action), **error}

        terms = jax.vmap(imitate)(batch)
        sums = {
            name: losses.weighted_sum(term, batch.weight)
            for name, term in terms.items()
        }
        return sums["loss"], sums | {"total_weight": batch.weight.sum()}

    def init(key: Key[Array, ""]) -> TrainState:
        key, params_key = jax.random.split(key)
        params = agent.init(params_key)
        opt_state = optimizer.transformation.init(params)
        return TrainState(
            params=params, opt_state=opt_state, step=jnp.zeros((), jnp.int32), key=key
        )

    def update(
        train_state: TrainState, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        num_devices = jax.lax.axis_size(axis_name)
        if batch_size % num_devices:
            raise ValueError(
                f"batch_size must be a multiple of the number of devices, got "
                f"{batch_size} for {num_devices}."
            )
        key, batch_key = jax.random.split(train_state.key)
        # The state's key stays the same everywhere; each device draws with its own.
        batch_key = jax.random.fold_in(batch_key, jax.lax.axis_index(axis_name))
        keys = jax.random.split(batch_key, batch_size // num_devices)
        batch = jax.vmap(sample, in_axes=(None, 0))(bank, keys)

        # Parameters marked as each device's own get that device's own gradient; without
        # the mark jax.grad would sum over devices, and the sum below would count twice.
        params = jax.lax.pcast(train_state.params, axis_name, to="varying")
        gradients, sums = jax.grad(local_sums, has_aux=True)(params, batch)
        gradients, sums = jax.lax.psum((gradients, sums), axis_name)

        total_weight = sums.pop("total_weight")
        divisor = jnp.where(total_weight > 0, total_weight, 1.0)
        gradients, means = jax.tree.map(lambda x: x / divisor, (gradients, sums))
        moved, metrics = optim.descend(
            optimizer, train_state.replace(key=key), gradients
        )
        return moved, means | {"total_weight": total_weight} | metrics

    return Learner(init=init, update=update)
