"""Tests how inputs are dealt out to shards."""

from drivetrain.sim.data import prepare


def num_shards(*sizes: int) -> int:
    """Returns how many shards are made of so many seeds at a time."""
    return len(list(prepare._groups([range(size) for size in sizes])))


def test_large_sets_make_full_shards_and_small_ones_at_least_32():
    assert num_shards(100 * prepare.SHARD_SEEDS) == 100
    assert num_shards(32 * prepare.SHARD_SEEDS) == 32
    assert num_shards(32 * 20) == 32
    assert num_shards(32 * 20, 32 * 10) == 32
    assert num_shards(20) == 3  # 8 seeds each


def test_small_files_share_a_shard_and_a_large_one_has_its_own(tmp_path, monkeypatch):
    paths = [tmp_path / str(number) for number in range(5)]
    for path in paths:
        path.write_bytes(bytes(100))
    monkeypatch.setattr(prepare, "FEW_SHARDS", 1)
    monkeypatch.setattr(prepare, "SHARD_BYTES", 101)
    paths[0].write_bytes(bytes(3 * prepare.SHARD_BYTES))

    groups = list(prepare._groups(paths))

    assert groups == [[paths[0]], paths[1:3], paths[3:]]
