"""Keeps the latest transitions on the device and draws those that surprise most.

A replay belongs to one device, or to one of several side by side there by vmap.
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PyTree

from ...sim import ranges
from ...sim.records import Record
from . import sum_tree
from .sum_tree import SumTree

MAX_COUNT = 2**31 - 1  # of insertions, in int32


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayConfig:
    """How much is kept, and how strongly surprise counts."""

    capacity: int = 1_000_000  # items
    priority_exponent: float = 0.6  # alpha; 0 draws all items alike
    importance_exponent: float = 0.4  # beta at the start of training
    final_importance_exponent: float = 1.0  # beta at its end
    epsilon: float = 1e-6  # added to absolute TD errors, so that all can be drawn

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if the capacity, an exponent or epsilon is out of range.
        """
        if not 1 <= self.capacity <= sum_tree.MAX_CAPACITY:
            raise ValueError(
                f"capacity must be from 1 to {sum_tree.MAX_CAPACITY:,}, got "
                f"{self.capacity:,}."
            )
        ranges.require_share(
            self,
            "priority_exponent",
            "importance_exponent",
            "final_importance_exponent",
        )
        if not 1e-30 <= self.epsilon < math.inf:
            raise ValueError(
                f"epsilon must be finite and at least 1e-30, since an item without "
                f"priority is never drawn again, got {self.epsilon}."
            )


class Replay(Record):
    """The latest items, in a ring, with their priorities."""

    items: PyTree[Array]  # [capacity, ...]; zeros where there is none yet
    tree: SumTree  # of priorities; zero where there is no item yet
    cursor: Int[Array, ""]  # where the next item goes
    num_added: Int[Array, ""]  # items ever added; stays at MAX_COUNT once there
    largest_priority: Float[Array, ""]  # of all so far, 1 at first

    @property
    def num_items(self) -> Int[Array, ""]:
        """How many items there are to draw."""
        return jnp.minimum(self.num_added, self.tree.capacity)


class Batch(Record):
    """Items drawn from a replay, with replacement."""

    items: PyTree[Array]  # [batch, ...]
    indices: Int[Array, " batch"]  # their places, for `set_priorities`
    weights: Float[Array, " batch"]  # of their losses, up to 1; zero without any item
    largest_weight: Float[Array, ""]  # the one that is 1, before all were divided by it


def make(item_like: PyTree, capacity: int) -> Replay:
    """Makes a replay without items.

    Args:
        item_like: one item, or anything with the shapes and dtypes of one.
        capacity: how many items are kept.

    Raises:
        ValueError: if the capacity is out of range.
    """
    items = jax.tree.map(
        lambda leaf: jnp.zeros((capacity, *leaf.shape), leaf.dtype), item_like
    )
    return Replay(
        items=items,
        tree=sum_tree.make(capacity),
        cursor=jnp.zeros((), jnp.int32),
        num_added=jnp.zeros((), jnp.int32),
        largest_priority=jnp.ones(()),
    )


@jax.named_scope("replay.add")
def add(
    replay: Replay,
    items: PyTree[Array],
    valid: Bool[Array, " items"] | None = None,
) -> Replay:
    """Puts items in the places of the oldest, with the largest priority so far.

    So each is likely to be drawn soon (Schaul et al. 2016, algorithm 1, line 6).

    Args:
        replay: to change; donate it, and the change is made in place.
        items: in the order of their age, oldest first [items, ...].
        valid: which of them to add; all if None.

    Raises:
        ValueError: while traced, if there are more items than places, or if they are
            unlike those of the replay in shape or dtype.
    """
    num_given = jax.tree.leaves(items)[0].shape[0]
    _check_fit(replay, items, num_given)
    valid = jnp.ones(num_given, bool) if valid is None else valid
    counts = jnp.cumsum(valid, dtype=jnp.int32)
    count = counts[-1]

    capacity = replay.tree.capacity
    place = (replay.cursor + counts - 1) % capacity
    place = jnp.where(valid, place, capacity)  # beyond the end, where it is dropped
    priorities = jnp.broadcast_to(replay.largest_priority, place.shape)
    return replay.replace(
        items=jax.tree.map(
            lambda kept, new: kept.at[place].set(new, mode="drop"), replay.items, items
        ),
        tree=sum_tree.update(replay.tree, place, priorities),
        cursor=(replay.cursor + count) % capacity,
        num_added=replay.num_added + jnp.minimum(count, MAX_COUNT - replay.num_added),
    )


@jax.named_scope("replay.sample")
def sample(
    replay: Replay,
    key: Key[Array, ""],
    batch_size: int,
    importance_exponent: float | Float[Array, ""],
) -> Batch:
    """Draws items in proportion to their priorities.

    Item i is drawn with the probability P(i) = p_i / sum_k p_k, and its loss has the
    weight (Schaul et al. 2016, equation 1 and section 3.4)

        w_i = (N P(i))^-beta / max_j w_j

    where N is the number of items and j goes through the batch. Departs from the source
    in drawing each item independently, not one from each of as many equal parts of the
    sum: such a place in the sum is one number, and too coarse (`sum_tree.sample`).

    Args:
        replay: to draw from; batches of an empty one have weights of zero.
        key: of the draws.
        batch_size: how many to draw.
        importance_exponent: beta, of the function of that name.
    """
    drawn = sum_tree.sample(replay.tree, key, batch_size)
    is_drawn = drawn.probabilities > 0
    expected = replay.num_items * jnp.where(is_drawn, drawn.probabilities, 1.0)
    weights = jnp.where(is_drawn, expected**-importance_exponent, 0.0)
    largest = weights.max()
    return Batch(
        items=jax.tree.map(
            lambda kept: kept.at[drawn.indices].get(mode="promise_in_bounds"),
            replay.items,
        ),
        indices=drawn.indices,
        weights=weights / jnp.where(largest > 0, largest, 1.0),
        largest_weight=largest,
    )


def weigh_together(batches: Batch, axis_names: tuple[str, ...] = ()) -> Batch:
    """Divides the weights of several batches by the largest among them all.

    Else the same item would count for more in a batch where all the others are likely.

    Args:
        batches: of replays side by side, all with a leading axis.
        axis_names: of the mesh, where there are more such batches.
    """
    largest = batches.largest_weight.max()
    if axis_names:
        largest = jax.lax.pmax(largest, axis_names)
    share = batches.largest_weight / jnp.where(largest > 0, largest, 1.0)
    return batches.replace(weights=batches.weights * share[:, None])


@jax.named_scope("replay.set_priorities")
def set_priorities(
    config: ReplayConfig,
    replay: Replay,
    indices: Int[Array, " batch"],
    td_errors: Float[Array, " batch"],
) -> Replay:
    """Makes items as likely to be drawn as their errors are large.

    With the TD error d and the exponent alpha (Schaul et al. 2016, section 3.3)

        p = (|d| + epsilon)^alpha

    An error that is not finite says nothing: its item counts as a new one.

    Args:
        config: of alpha and epsilon.
        replay: the one that the indices are of, before anything is added to it: an item
            that took a drawn one's place would get its priority.
        indices: of `Batch`. Of an item drawn twice the last error counts.
        td_errors: of those items.
    """
    priorities = (jnp.abs(td_errors) + config.epsilon) ** config.priority_exponent
    priorities = jnp.where(
        jnp.isfinite(priorities), priorities, replay.largest_priority
    )
    is_item = indices < replay.num_items  # False of what an empty replay gives
    largest = jnp.max(jnp.where(is_item, priorities, 0.0))
    return replay.replace(
        tree=sum_tree.update(
            replay.tree,
            jnp.where(is_item, indices, replay.tree.capacity),
            priorities,
        ),
        largest_priority=jnp.maximum(replay.largest_priority, largest),
    )


def importance_exponent(
    config: ReplayConfig, fraction: float | Float[Array, ""]
) -> Float[Array, ""]:
    """Returns beta when a fraction of the training is done.

    It goes from `importance_exponent` to `final_importance_exponent` along a line.
    """
    start, end = config.importance_exponent, config.final_importance_exponent
    return start + jnp.clip(fraction, 0.0, 1.0) * (end - start)


def _check_fit(replay: Replay, items: PyTree[Array], num_given: int) -> None:
    """Raises ValueError unless the items can go into the replay.

    A write would stretch a shape, or cut a dtype, that does not fit.
    """
    capacity = replay.tree.capacity
    if not 1 <= num_given <= capacity:
        raise ValueError(
            f"items must be from 1 to the capacity {capacity:,} at once, got "
            f"{num_given:,}."
        )

    def check(path: tuple, kept: Array, new: Array) -> None:
        expected = (num_given, *kept.shape[1:])
        if new.shape != expected or new.dtype != kept.dtype:
            raise ValueError(
                f"items must be {kept.dtype}{list(expected)} at "
                f"'{jax.tree_util.keystr(path)}', got {new.dtype}{list(new.shape)}."
            )

    jax.tree_util.tree_map_with_path(check, replay.items, items)
