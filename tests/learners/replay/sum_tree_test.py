"""Tests of the tree of sums: what it holds, and whom it draws."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from drivetrain.learners.replay import sum_tree
from drivetrain.learners.replay.sum_tree import BRANCHING, SumTree

# Float32: 15 additions a level, 5 levels, each wrong by 2^-24 at most.
ROUNDING = 75 * 2.0**-24
# Of a test that passes; seeds are fixed.
P_VALUE = 1e-4
CAPACITIES = [1, 5, 16, 17, 300, 5000]

update = jax.jit(sum_tree.update)
sample = jax.jit(sum_tree.sample, static_argnums=2)


def tree_of(priorities: np.ndarray) -> SumTree:
    tree = sum_tree.make(len(priorities))
    return update(tree, jnp.arange(len(priorities)), jnp.asarray(priorities))


def spread(low: float, high: float) -> Callable[[np.random.Generator], np.ndarray]:
    """Draws priorities whose logarithms are uniform."""
    return lambda rng: np.exp(rng.uniform(np.log(low), np.log(high), 700))


SHAPES = {
    "equal": lambda rng: np.full(700, 3.0),
    "uniform": lambda rng: rng.random(700),
    "wide": spread(1e-6, 1e3),
    "tiny": spread(1e-30, 1e-28),
    "one_heavy": lambda rng: np.where(np.arange(700) == 123, 500.0, 1.0),
    "sorted": lambda rng: np.sort(spread(1e-2, 1e2)(rng)),
    "mostly_zero": lambda rng: np.where(rng.random(700) < 0.97, 0.0, rng.random(700)),
}


def random_sets(
    seed: int, capacity: int, num_sets: int
) -> tuple[np.ndarray, np.ndarray]:
    """Draws sets of 64, some outside of the capacity and some to zero."""
    rng = np.random.default_rng(seed)
    indices = rng.integers(-2, capacity + 3, (num_sets // 64, 64), dtype=np.int32)
    priorities = np.exp(rng.uniform(-14, 7, indices.shape)).astype(np.float32)
    return indices, np.where(rng.random(indices.shape) < 0.2, np.float32(0), priorities)


@jax.jit
def update_often(tree: SumTree, indices: jax.Array, priorities: jax.Array) -> SumTree:
    def step(tree: SumTree, sets: tuple[jax.Array, jax.Array]) -> tuple[SumTree, None]:
        return sum_tree.update(tree, *sets), None

    return jax.lax.scan(step, tree, (indices, priorities))[0]


def sums_below(priorities: np.ndarray) -> np.ndarray:
    """Oracle of the nodes, in float64: each level from the one below it."""
    levels = [priorities.astype(np.float64)]
    while len(levels[0]) > BRANCHING:
        padded = np.pad(levels[0], (0, -len(levels[0]) % BRANCHING))
        levels.insert(0, padded.reshape(-1, BRANCHING).sum(axis=1))
    # Upper levels are complete, though nothing may lie below their last nodes.
    widths = [BRANCHING ** (i + 1) for i in range(len(levels) - 1)] + [len(priorities)]
    parts = zip(levels, widths, strict=True)
    return np.concatenate([np.pad(x, (0, width - len(x))) for x, width in parts])


@pytest.mark.parametrize("capacity", CAPACITIES)
def test_priorities_are_those_set_last(capacity: int) -> None:
    indices, priorities = random_sets(1, capacity, 4096)
    expected = np.zeros(capacity, np.float32)
    for index, priority in zip(indices.flat, priorities.flat, strict=True):
        if 0 <= index < capacity:
            expected[index] = priority
    tree = update_often(sum_tree.make(capacity), indices, priorities)
    np.testing.assert_array_equal(tree.priorities, expected)


@pytest.mark.parametrize("capacity", CAPACITIES)
def test_sums_are_those_of_float64_after_many_sets(capacity: int) -> None:
    tree = update_often(sum_tree.make(capacity), *random_sets(2, capacity, 100_032))
    expected = sums_below(np.asarray(tree.priorities))
    nodes = np.asarray(tree.nodes).reshape(-1)
    np.testing.assert_allclose(nodes[: len(expected)], expected, rtol=ROUNDING)
    assert not nodes[len(expected) :].any()
    exact = np.asarray(tree.priorities, np.float64).sum()
    np.testing.assert_allclose(sum_tree.total(tree), exact, rtol=ROUNDING)


def test_of_equal_indices_the_last_counts() -> None:
    tree = update(
        sum_tree.make(300), jnp.array([7, 290, 7, 7, 290]), jnp.arange(1.0, 6.0)
    )
    assert (tree.priorities[7], tree.priorities[290]) == (4.0, 5.0)
    assert sum_tree.total(tree) == 9.0


def test_priorities_without_use_count_as_zero_and_vast_ones_stay_finite() -> None:
    priorities = jnp.array([jnp.nan, -1.0, 1e-40, jnp.inf, 3e38])
    tree = update(sum_tree.make(20), jnp.arange(5), priorities)
    most = sum_tree.LARGEST_PRIORITY
    np.testing.assert_allclose(
        tree.priorities[:5], [0, 0, 0, most, most], rtol=ROUNDING
    )
    assert jnp.isfinite(sum_tree.total(tree))


@pytest.mark.parametrize("shape", SHAPES)
def test_draws_match_their_exact_probabilities(shape: str) -> None:
    priorities = SHAPES[shape](np.random.default_rng(3)).astype(np.float32)
    num_draws = 400_000
    drawn = sample(tree_of(priorities), jax.random.key(4), num_draws)
    counts = np.bincount(drawn.indices, minlength=len(priorities))
    expected = priorities.astype(np.float64) / priorities.sum(dtype=np.float64)
    expected *= num_draws

    # The chi-square distribution needs about ten of each: the rare ones count as one.
    is_rare = expected < 10
    observed = np.append(counts[~is_rare], counts[is_rare].sum())
    expected = np.append(expected[~is_rare], expected[is_rare].sum())
    observed, expected = observed[expected > 0], expected[expected > 0]
    assert stats.chisquare(observed, expected).pvalue > P_VALUE


@pytest.mark.parametrize("shape", SHAPES)
def test_probabilities_are_priorities_over_their_sum(shape: str) -> None:
    priorities = SHAPES[shape](np.random.default_rng(5)).astype(np.float32)
    drawn = sample(tree_of(priorities), jax.random.key(6), 5000)
    expected = priorities.astype(np.float64) / priorities.sum(dtype=np.float64)
    np.testing.assert_allclose(
        drawn.probabilities, expected[drawn.indices], rtol=2 * ROUNDING
    )


def test_items_of_priority_zero_are_never_drawn() -> None:
    rng = np.random.default_rng(7)
    priorities = np.zeros(100_000, np.float32)
    priorities[rng.choice(100_000, 60, replace=False)] = spread(1e-6, 1e3)(rng)[:60]
    drawn = sample(tree_of(priorities), jax.random.key(8), 1_000_000)
    assert priorities[drawn.indices].min() > 0


@pytest.mark.parametrize(("uniform", "expected"), [(0.0, 5), (1.0, 280)])
def test_random_numbers_at_the_ends_draw_the_outermost_items(
    monkeypatch: pytest.MonkeyPatch, uniform: float, expected: int
) -> None:
    # One is out of the generator's range: no rounding of sums can reach further.
    monkeypatch.setattr(
        jax.random, "uniform", lambda _, shape: jnp.full(shape, uniform)
    )
    priorities = np.zeros(300, np.float32)
    priorities[[5, 77, 200, 280]] = [1e-6, 1e3, 0.1, 1e-6]
    drawn = sum_tree.sample(tree_of(priorities), jax.random.key(0), 3)
    np.testing.assert_array_equal(drawn.indices, [expected] * 3)


def test_a_million_equal_items_are_drawn_alike() -> None:
    # One random number of 23 bits, for all the way down, has 9 values for some items
    # and 8 for the others: those with 9 would be drawn 7 percent too often.
    num_items, num_draws = 1_000_000, 1_000_000
    values = -(-np.arange(num_items + 1) * 2**23 // num_items)
    is_favoured = np.diff(values) == 9
    tree = tree_of(np.ones(num_items, np.float32))
    drawn = sample(tree, jax.random.key(9), num_draws)
    count = int(is_favoured[drawn.indices].sum())
    assert stats.binomtest(count, num_draws, is_favoured.mean()).pvalue > P_VALUE


@pytest.mark.parametrize("capacity", CAPACITIES)
def test_a_tree_of_zeros_draws_item_0_with_probability_zero(capacity: int) -> None:
    drawn = sample(sum_tree.make(capacity), jax.random.key(10), 20)
    assert not drawn.indices.any() and not drawn.probabilities.any()


def test_trees_side_by_side_do_as_each_alone() -> None:
    indices, priorities = random_sets(11, 300, 256)
    keys = jax.random.split(jax.random.key(12), len(indices))
    trees = jax.vmap(lambda _: sum_tree.make(300))(keys)
    trees = jax.jit(jax.vmap(sum_tree.update))(trees, indices, priorities)
    drawn = jax.jit(jax.vmap(lambda t, key: sum_tree.sample(t, key, 50)))(trees, keys)
    for i in range(len(indices)):
        alone = update(sum_tree.make(300), indices[i], priorities[i])
        np.testing.assert_array_equal(trees.nodes[i], alone.nodes)
        drawn_alone = sample(alone, keys[i], 50)
        np.testing.assert_array_equal(drawn.indices[i], drawn_alone.indices)


@pytest.mark.parametrize("capacity", [0, 2**30 + 1])
def test_capacities_out_of_range_are_named(capacity: int) -> None:
    with pytest.raises(ValueError, match=r"capacity must be from 1 to 1,073,741,824"):
        sum_tree.make(capacity)
