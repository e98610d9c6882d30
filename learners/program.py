"""Compiles what runs on a mesh: the one place that shards and donates."""

from collections.abc import Callable
from typing import Any

import jax
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Key

from . import mesh as meshes
from .base import Bank, Experience, Learner, Metrics, Program, TrainState

EVERYWHERE, BY_DEVICE = PartitionSpec(), PartitionSpec(meshes.AXIS)


def _layout(num_axes: int) -> Any:
    """Returns where the parts of a train state lie; only worlds differ by device.

    Args:
        num_axes: of seeds before all others: 1 for several, 0 for one.
    """
    return TrainState(
        params=EVERYWHERE,
        opt_state=EVERYWHERE,
        step=EVERYWHERE,  # pyright: ignore[reportArgumentType]  (a spec of each array)
        key=EVERYWHERE,  # pyright: ignore[reportArgumentType]
        kept=EVERYWHERE,
        worlds=PartitionSpec(*[None] * num_axes, meshes.AXIS),
    )


def initial_state(
    learner: Learner, mesh: Mesh, key: Key[Array, "*seeds"], bank: Bank
) -> TrainState:
    """Makes the state before the first update.

    Args:
        learner: whose state.
        mesh: the devices.
        key: of all that is random, or one of each of several seeds.
        bank: every leaf sharded along a leading axis of devices.
    """

    def init(key: Key[Array, ""], bank: Bank) -> TrainState:
        return learner.init(key, _local(bank), meshes.AXIS)

    sharded = jax.shard_map(
        jax.vmap(init, in_axes=(0, None)) if key.ndim else init,
        mesh=mesh,
        in_specs=(EVERYWHERE, BY_DEVICE),
        out_specs=_layout(key.ndim),
    )
    return jax.jit(sharded)(meshes.replicate(mesh, key), bank)


def compile_program(
    learner: Learner,
    mesh: Mesh,
    updates_per_call: int,
    over_seeds: Callable[[Program], Program] = lambda run: run,
) -> Program:
    """Compiles several updates of a learner into one program.

    Args:
        learner: what to run.
        mesh: the devices to run on.
        updates_per_call: how many updates one call makes, with no host in between.
        over_seeds: runs several seeds, such as `seeds.side_by_side`; as is, one alone.

    Returns:
        A function of the train state (donated, so the argument is gone after the call)
        and the bank (every leaf sharded along a leading axis of devices). It returns
        the new train state and the metrics of each of its updates, stacked.

    Raises:
        ValueError: if there is no update in a call.
    """
    if updates_per_call < 1:
        raise ValueError(
            f"updates_per_call must be at least 1, got {updates_per_call}."
        )

    def run(train_state: TrainState, bank: Bank) -> tuple[TrainState, Metrics]:
        local_bank = _local(bank)

        def update(train_state: TrainState, _: None) -> tuple[TrainState, Metrics]:
            return learner.update(train_state, local_bank, meshes.AXIS)

        return jax.lax.scan(update, train_state, length=updates_per_call)

    def program(train_state: TrainState, bank: Bank) -> tuple[TrainState, Metrics]:
        layout = _layout(train_state.step.ndim)
        sharded = jax.shard_map(
            over_seeds(run),
            mesh=mesh,
            in_specs=(layout, BY_DEVICE),
            out_specs=(layout, EVERYWHERE),
        )
        return sharded(train_state, bank)

    return jax.jit(program, donate_argnums=0)


def compile_halves(
    learner: Learner, mesh: Mesh, updates_per_call: int
) -> tuple[
    Callable[[TrainState, Bank], tuple[TrainState, Experience]],
    Callable[[TrainState, Bank, Experience], TrainState],
]:
    """Compiles acting without learning, and learning without acting.

    They are there to be measured: what one costs with the other left out.

    Returns:
        A function of train state and bank that acts as often as `updates_per_call`
        says; it returns the train state and the last experience. And one of both and an
        experience that learns from it as often; it returns the train state. Both donate
        the train state.
    """

    def act(train_state: TrainState, bank: Bank) -> tuple[TrainState, Experience]:
        local_bank = _local(bank)

        def once(carry, _: None):
            return learner.act(carry[0], local_bank, meshes.AXIS), None

        # The first one stands for all: each next writes over what it gave.
        first = learner.act(train_state, local_bank, meshes.AXIS)
        (state, last), _ = jax.lax.scan(once, first, length=updates_per_call - 1)
        return state, jax.tree.map(lambda leaf: leaf[None], last)

    def learn(
        train_state: TrainState, bank: Bank, experience: Experience
    ) -> TrainState:
        local_bank, experience = _local(bank), _local(experience)

        def once(train_state: TrainState, _: None) -> tuple[TrainState, None]:
            learned = learner.learn(train_state, experience, local_bank, meshes.AXIS)
            return learned[0], None

        return jax.lax.scan(once, train_state, length=updates_per_call)[0]

    layout = _layout(0)
    acting = jax.shard_map(
        act, mesh=mesh, in_specs=(layout, BY_DEVICE), out_specs=(layout, BY_DEVICE)
    )
    learning = jax.shard_map(
        learn, mesh=mesh, in_specs=(layout, BY_DEVICE, BY_DEVICE), out_specs=layout
    )
    return jax.jit(acting, donate_argnums=0), jax.jit(learning, donate_argnums=0)


def _local(bank: Bank) -> Bank:
    return jax.tree.map(lambda leaf: leaf[0], bank)


def compile_replacement() -> Callable[[Bank, Bank, Array], Bank]:
    """Compiles what puts one page of a bank in the place of another.

    Returns:
        A function of the bank (donated), the page, both sharded along a leading axis of
        devices, and the number of the page. Arrays of one number a device stay as they
        are. It returns the bank.
    """

    def replace(bank: Bank, page: Bank, number: Array) -> Bank:
        def put(whole: Array, part: Array) -> Array:
            if part.ndim == 1:
                return whole
            start = number * part.shape[1]
            return jax.lax.dynamic_update_slice_in_dim(whole, part, start, axis=1)

        return jax.tree.map(put, bank, page)

    return jax.jit(replace, donate_argnums=0)
