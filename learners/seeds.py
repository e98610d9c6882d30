"""Trains several seeds in one program: side by side, or one after another.

Side by side they fill an accelerator that one leaves idle. A CPU is full with one, and
there one after another is no slower, and often faster. Every array of a train state of
several has a leading axis of seeds; those of their metrics are `[updates, seeds]`.
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from .base import Bank, Metrics, Program, TrainState

Tree = TypeVar("Tree")


def side_by_side(run: Program) -> Program:
    """Runs all seeds at once; each ends as it would alone, up to the order of sums."""
    return jax.vmap(run, in_axes=(0, None), out_axes=(0, 1))


def in_turn(run: Program) -> Program:
    """Runs one seed after another, by the very program that one alone would take."""

    def run_each(train_states: TrainState, bank: Bank) -> tuple[TrainState, Metrics]:
        def run_one(
            train_states: TrainState, number: Int[Array, ""]
        ) -> tuple[TrainState, Metrics]:
            moved, metrics = run(one_of(train_states, number), bank)

            def put(leaf: Array, new: Array) -> Array:
                return jax.lax.dynamic_update_index_in_dim(leaf, new, number, 0)

            return jax.tree.map(put, train_states, moved), metrics

        # Carried on, not stacked anew, so that there is no second copy of all.
        numbers = jnp.arange(len(train_states.step))
        moved, metrics = jax.lax.scan(run_one, train_states, numbers)
        return moved, jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1), metrics)

    return run_each


def one_of(of_seeds: Tree, number: int | Int[Array, ""]) -> Tree:
    """Returns what one of several seeds has of a tree, such as their train states."""

    def take(leaf: Array) -> Array:
        return jax.lax.dynamic_index_in_dim(leaf, number, 0, keepdims=False)

    return jax.tree.map(take, of_seeds)
