"""Tests of prioritized replay: the ring, the weights, and that nothing is copied."""

import collections

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import PartitionSpec

from drivetrain.learners import mesh as meshes
from drivetrain.learners.replay import prioritized
from drivetrain.learners.replay.prioritized import Batch, Replay, ReplayConfig

ROUNDING = 1e-5  # float32: a power of a product of a few rounded shares
CONFIG = ReplayConfig(capacity=10, priority_exponent=0.5, epsilon=0.01)
ITEM = {"number": jnp.zeros((), jnp.int32), "xy": jnp.zeros(2)}

add = jax.jit(prioritized.add)
sample = jax.jit(prioritized.sample, static_argnums=2)


def numbered(values: np.ndarray) -> dict[str, jax.Array]:
    """Makes items that can be told apart."""
    numbers = jnp.asarray(values, jnp.int32)
    return {"number": numbers, "xy": jnp.stack([numbers, -numbers], axis=1) * 1.0}


def filled(num_items: int, capacity: int) -> Replay:
    replay = prioritized.make(ITEM, capacity)
    return add(replay, numbered(np.arange(num_items)))


def set_priorities(replay: Replay, indices: list[int], errors: list[float]) -> Replay:
    change = jax.jit(prioritized.set_priorities, static_argnums=0)
    return change(CONFIG, replay, jnp.array(indices), jnp.array(errors))


def in_order_of_age(replay: Replay) -> list[int]:
    """Lists the numbers of the items there are, oldest first."""
    num_items, capacity = int(replay.num_items), replay.tree.capacity
    places = (int(replay.cursor) - num_items + np.arange(num_items)) % capacity
    np.testing.assert_array_equal(np.asarray(replay.tree.priorities)[places] > 0, True)
    assert (np.asarray(replay.tree.priorities) > 0).sum() == num_items
    xy = np.asarray(replay.items["xy"])[places]
    np.testing.assert_array_equal(xy[:, 0], -xy[:, 1])
    return xy[:, 0].astype(int).tolist()


@pytest.mark.parametrize("seed", range(8))
def test_the_ring_keeps_the_latest_valid_items_as_a_deque_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model: collections.deque[int] = collections.deque(maxlen=10)
    replay, num_added = prioritized.make(ITEM, 10), 0
    for i in range(12):
        numbers, valid = np.arange(7) + 7 * i, rng.random(7) < rng.random()
        replay = add(replay, numbered(numbers), jnp.array(valid))
        model.extend(numbers[valid].tolist())
        num_added += int(valid.sum())
        assert in_order_of_age(replay) == list(model)
        assert replay.num_added == num_added


def test_items_without_a_mask_are_all_added() -> None:
    assert in_order_of_age(filled(4, 10)) == [0, 1, 2, 3]


def test_the_count_of_insertions_stops_before_it_overflows() -> None:
    almost = jnp.array(prioritized.MAX_COUNT - 2, jnp.int32)
    replay = add(filled(10, 10).replace(num_added=almost), numbered(np.arange(20, 25)))
    assert replay.num_added == prioritized.MAX_COUNT
    assert in_order_of_age(replay) == [5, 6, 7, 8, 9, 20, 21, 22, 23, 24]


def test_new_items_get_the_largest_priority_so_far() -> None:
    replay = filled(3, 10)
    np.testing.assert_array_equal(replay.tree.priorities[:4], [1, 1, 1, 0])
    # (3.60 + 0.01)^0.5 = 1.9, once seen, counts even when no item has it any more.
    replay = set_priorities(replay, [1], [3.60])
    replay = set_priorities(replay, [1], [0.24])
    replay = add(replay, numbered(np.array([3])))
    expected = [1.0, 0.5, 1.0, 1.9, 0.0]
    np.testing.assert_allclose(replay.tree.priorities[:5], expected, rtol=ROUNDING)


def test_priorities_are_powers_of_absolute_errors() -> None:
    # Of item 2, drawn twice, the last error counts. Item 0 keeps its priority.
    replay = set_priorities(filled(4, 10), [1, 2, 3, 2], [-0.15, 9.0, 0.0, 0.35])
    expected = [1.0, 0.4, 0.6, 0.1]
    np.testing.assert_allclose(replay.tree.priorities[:4], expected, rtol=ROUNDING)


@pytest.mark.parametrize("error", [np.nan, np.inf, -np.inf])
def test_items_with_errors_that_are_not_finite_count_as_new(error: float) -> None:
    replay = set_priorities(filled(4, 10), [1, 2], [3.60, error])
    replay = set_priorities(replay, [3], [error])
    expected = [1.0, 1.9, 1.0, 1.9]
    np.testing.assert_allclose(replay.tree.priorities[:4], expected, rtol=ROUNDING)
    np.testing.assert_allclose(replay.largest_priority, 1.9, rtol=ROUNDING)


def test_importance_weights_by_hand() -> None:
    # Priorities 0.1, 0.2, 0.3, 0.4 of N = 4: N P = 0.4, 0.8, 1.2, 1.6.
    errors = [0.0, 0.03, 0.08, 0.15]
    replay = set_priorities(filled(4, 10), [0, 1, 2, 3], errors)
    batch = sample(replay, jax.random.key(0), 64, 0.5)
    # (N P)^-0.5 over the largest, that of item 0: (0.4 / N P)^0.5.
    by_hand = np.array([1.0, 0.70710678, 0.57735027, 0.5])
    assert set(batch.indices.tolist()) == {0, 1, 2, 3}
    np.testing.assert_allclose(batch.weights, by_hand[batch.indices], rtol=ROUNDING)
    np.testing.assert_array_equal(batch.items["number"], batch.indices)
    np.testing.assert_array_equal(batch.items["xy"][:, 1], -batch.indices)


def test_the_largest_weight_is_of_those_drawn() -> None:
    # Item 0, of the largest weight, is 1e4 times less likely than the others.
    replay = set_priorities(filled(3, 10), [0, 1, 2], [0.0, 1e6, 4e6])
    batch = sample(replay, jax.random.key(1), 32, 1.0)
    assert set(batch.indices.tolist()) == {1, 2}
    np.testing.assert_allclose(
        batch.weights, np.where(batch.indices == 1, 1.0, 0.5), rtol=ROUNDING
    )


def test_full_weights_undo_the_priorities() -> None:
    replay = set_priorities(filled(4, 10), [0, 1, 2, 3], [0.0, 0.03, 0.08, 0.15])
    batch = sample(replay, jax.random.key(2), 100_000, 1.0)
    sums = np.bincount(batch.indices, weights=np.asarray(batch.weights, np.float64))
    # Item 0 is drawn 1e4 times with weight 1: a standard deviation of a percent.
    np.testing.assert_allclose(sums / sums.sum(), 0.25, atol=4 * 0.25 * 0.01)


def test_replays_of_one_batch_share_its_largest_weight() -> None:
    # One has all items alike; of the other, N P is 0.2 or 1.8, and item 0 is drawn.
    other = set_priorities(filled(2, 10), [0, 1], [0.0, 0.80])
    replays = jax.tree.map(lambda *x: jnp.stack(x), filled(2, 10), other)
    keys = jax.random.split(jax.random.key(0))
    batch = jax.vmap(lambda r, key: prioritized.sample(r, key, 8, 1.0))(replays, keys)
    np.testing.assert_array_equal(batch.weights[0], np.ones(8))
    batch = prioritized.weigh_together(batch)
    assert set(batch.indices[1].tolist()) == {0, 1}
    np.testing.assert_allclose(batch.weights[0], 0.2, rtol=ROUNDING)
    expected = np.where(batch.indices[1] == 0, 1.0, 1 / 9)
    np.testing.assert_allclose(batch.weights[1], expected, rtol=ROUNDING)


def test_an_empty_replay_gives_no_weight_and_takes_no_priorities() -> None:
    replay = prioritized.make(ITEM, 10)
    batch = sample(replay, jax.random.key(4), 5, 0.4)
    np.testing.assert_array_equal(batch.weights, np.zeros(5))
    replay = set_priorities(replay, batch.indices.tolist(), [7.0] * 5)
    assert not replay.tree.nodes.any()
    assert replay.largest_priority == 1


def learn(replay: Replay, key: jax.Array) -> Replay:
    """Adds, draws and sets priorities, as a learner does."""
    key, xy_key = jax.random.split(key)
    items = {
        "number": jax.random.randint(key, (16,), 0, 100),
        "xy": jax.random.normal(xy_key, (16, 2)),
    }
    replay = prioritized.add(replay, items, items["number"] < 60)
    batch = prioritized.sample(replay, key, 64, 0.4)
    errors = batch.weights * batch.items["xy"][:, 0]
    return prioritized.set_priorities(CONFIG, replay, batch.indices, errors)


def learn_often(replay: Replay, keys: jax.Array) -> Replay:
    return jax.lax.scan(lambda r, key: (learn(r, key), None), replay, keys)[0]


@pytest.mark.parametrize("program", ["add", "learn_often", "learn_side_by_side"])
def test_a_donated_replay_is_changed_in_place(program: str) -> None:
    replay = jax.eval_shape(lambda: prioritized.make(ITEM, 1_000_000))
    keys = jax.eval_shape(lambda: jax.random.split(jax.random.key(0), 5))
    items = jax.eval_shape(lambda: numbered(np.arange(64)))
    if program == "add":
        function, arguments = prioritized.add, (replay, items)
    elif program == "learn_often":
        function, arguments = learn_often, (replay, keys)
    else:
        function = jax.vmap(learn_often)
        arguments = jax.tree.map(
            lambda x: jax.ShapeDtypeStruct((2, *x.shape), x.dtype), (replay, keys)
        )
    compiled = jax.jit(function, donate_argnums=0).lower(*arguments).compile()

    memory = compiled.memory_analysis()
    assert memory is not None
    size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(arguments[0]))
    assert memory.alias_size_in_bytes >= size
    assert memory.temp_size_in_bytes < size / 20  # no array of a million among them


def test_replays_side_by_side_do_as_each_alone() -> None:
    keys = jax.random.split(jax.random.key(5), (3, 20))
    replays = jax.vmap(lambda _: prioritized.make(ITEM, 100))(keys)
    together = jax.jit(jax.vmap(learn_often))(replays, keys)
    for i in range(3):
        alone = jax.jit(learn_often)(prioritized.make(ITEM, 100), keys[i])
        for one, several in zip(
            jax.tree.leaves(alone), jax.tree.leaves(together), strict=True
        ):
            np.testing.assert_allclose(one, several[i], rtol=ROUNDING)


def test_a_mesh_takes_a_replay_on_each_device() -> None:
    mesh = meshes.data_mesh()
    keys = jax.random.split(jax.random.key(6), (mesh.size, 20))
    replays = jax.vmap(lambda _: prioritized.make(ITEM, 100))(keys)

    def run(replays: Replay, keys: jax.Array) -> tuple[Replay, Batch]:
        replays = jax.vmap(learn_often)(replays, keys)
        batch = jax.vmap(lambda r, key: prioritized.sample(r, key, 8, 1.0))(
            replays, keys[:, 0]
        )
        batch = prioritized.weigh_together(batch, (meshes.AXIS,))
        return replays, batch

    shares = PartitionSpec(meshes.AXIS)
    sharded = jax.shard_map(run, mesh=mesh, in_specs=shares, out_specs=shares)
    replays, batch = jax.jit(sharded)(replays, keys)
    alone = jax.jit(learn_often)(prioritized.make(ITEM, 100), keys[0])
    np.testing.assert_allclose(replays.tree.nodes[0], alone.tree.nodes, rtol=ROUNDING)
    assert batch.weights.max() == 1


def test_beta_goes_along_a_line_and_stays_at_its_end() -> None:
    config = ReplayConfig(importance_exponent=0.4, final_importance_exponent=0.8)
    betas = [prioritized.importance_exponent(config, x) for x in (0.0, 0.25, 1.0, 2.0)]
    np.testing.assert_allclose(betas, [0.4, 0.5, 0.8, 0.8], rtol=ROUNDING)


def test_items_that_do_not_fit_are_named() -> None:
    replay = prioritized.make(ITEM, 10)
    with pytest.raises(ValueError, match=r"from 1 to the capacity 10 at once, got 11"):
        prioritized.add(replay, numbered(np.arange(11)))
    items = numbered(np.arange(3))
    with pytest.raises(ValueError, match=r"float32\[3, 2\] at '\['xy'\]', got float"):
        prioritized.add(replay, items | {"xy": jnp.zeros((3, 1))})
    with pytest.raises(ValueError, match=r"int32\[3\] at .* got float32\[3\]"):
        prioritized.add(replay, items | {"number": jnp.zeros(3)})


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"capacity": 0}, "capacity must be from 1 to 1,073,741,824, got 0"),
        ({"priority_exponent": 1.5}, "priority_exponent must be from 0 to 1, got 1.5"),
        ({"importance_exponent": -0.1}, "importance_exponent must be from 0 to 1"),
        ({"final_importance_exponent": 2.0}, "final_importance_exponent must be"),
        ({"epsilon": 0.0}, "without priority is never drawn again, got 0.0"),
        ({"epsilon": float("nan")}, "epsilon must be finite"),
    ],
)
def test_configs_out_of_range_are_named(change: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        ReplayConfig(**change)
