"""Trains several seeds in one program: side by side, or one after another.

Side by side they fill an accelerator that one leaves idle. A CPU is full with one, and
there one after another is faster.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, Key

from .base import Bank, Metrics, Program, TrainState

# Where the seeds lie in a train state: behind the strata in the worlds, which are
# shared out among devices along their first axis, and first in all else.
AXES = TrainState(
    params=0,
    opt_state=0,
    step=0,  # pyright: ignore[reportArgumentType]  (an axis for each array)
    key=0,  # pyright: ignore[reportArgumentType]
    kept=0,
    worlds=1,
)


def begin(
    init: Callable[[Key[Array, ""], Bank], TrainState],
) -> Callable[[Key[Array, " seeds"], Bank], TrainState]:
    """Makes the first states of several seeds from what makes that of one."""
    return jax.vmap(init, in_axes=(0, None), out_axes=AXES)


def side_by_side(run: Program) -> Program:
    """Runs all seeds at once; each ends as it would alone, up to the order of sums."""
    return jax.vmap(run, in_axes=(AXES, None), out_axes=(AXES, 1))


def in_turn(run: Program) -> Program:
    """Runs one seed after another, by the very program that one alone would take."""

    def run_each(train_states: TrainState, bank: Bank) -> tuple[TrainState, Metrics]:
        def run_one(
            train_states: TrainState, number: Int[Array, ""]
        ) -> tuple[TrainState, Metrics]:
            moved, metrics = run(one_of(train_states, number), bank)
            return _put(train_states, number, moved), metrics

        numbers = jnp.arange(len(train_states.step))
        moved, metrics = jax.lax.scan(run_one, train_states, numbers)
        return moved, jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1), metrics)

    return run_each


def one_of(train_states: TrainState, number: int | Int[Array, ""]) -> TrainState:
    """Returns the train state of one of several seeds."""

    def take(axis: int, part):
        return jax.tree.map(
            lambda leaf: jax.lax.dynamic_index_in_dim(leaf, number, axis, False), part
        )

    return jax.tree.map(take, AXES, train_states)


def _put(
    train_states: TrainState, number: Int[Array, ""], own: TrainState
) -> TrainState:
    """Returns train states with that of one seed in its place."""

    def put(axis: int, all_of, one):
        return jax.tree.map(
            lambda leaf, new: jax.lax.dynamic_update_index_in_dim(
                leaf, new, number, axis
            ),
            all_of,
            one,
        )

    return jax.tree.map(put, AXES, train_states, own)
