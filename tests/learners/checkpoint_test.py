"""Tests that what is restored is what was saved, whatever happens to the files."""

import logging
import pathlib
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import checkpoint, mesh as meshes, optim, program
from drivetrain.learners.bc import CloningConfig, behavior_cloning
from drivetrain.learners.checkpoint import Checkpoints
from tests.learners import toy


def tree(seed: int) -> dict:
    key = jax.random.key(seed)
    return {
        "layers": {0: jax.random.normal(key, (50, 30)), 1: jnp.arange(3)},
        "half": jax.random.normal(key, (5,), jnp.bfloat16),
        "key": key,
        "keys": jax.random.split(key, 3),
        "flags": np.array([True, False]),
        "empty": jnp.zeros((0, 2)),
    }


def assert_same(found: dict, expected: dict) -> None:
    def plain(leaf: jax.Array | np.ndarray) -> np.ndarray:
        is_key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(leaf) if is_key else leaf)

    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for one, other in zip(
        jax.tree.leaves(found), jax.tree.leaves(expected), strict=True
    ):
        assert type(one) is type(other) and one.dtype == other.dtype
        assert plain(one).tobytes() == plain(other).tobytes()


def flip_a_bit(step: pathlib.Path) -> None:
    """Damages the middle of the largest file of a step."""
    files = [path for path in step.rglob("*") if path.is_file()]
    largest = max(files, key=lambda path: path.stat().st_size)
    content = bytearray(largest.read_bytes())
    content[len(content) // 2] ^= 1
    largest.write_bytes(content)


def change_the_metadata(step: pathlib.Path) -> None:
    """Turns one digit into another."""
    path = step / "_CHECKPOINT_METADATA"
    content = path.read_text()
    assert content.count("123456") == 1
    path.write_text(content.replace("123456", "123457"))


def cut_short(step: pathlib.Path) -> None:
    """Halves the files of data."""
    for path in step.rglob("d/*"):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty_the_folder(step: pathlib.Path) -> None:
    """Deletes every file."""
    for path in step.rglob("*"):
        if path.is_file():
            path.unlink()


def test_arrays_keys_and_metadata_come_back_bit_for_bit(tmp_path: pathlib.Path) -> None:
    metadata = {
        "config": {"name": "bc", "rate": 1e-4},
        "cursor": [3, 2**60],
        "note": None,
    }
    Checkpoints(tmp_path).save(7, tree(1), metadata)
    restored = Checkpoints(tmp_path).restore(tree(0))
    assert (restored.step, restored.metadata) == (7, metadata)
    assert_same(restored.tree, tree(1))


def test_only_the_newest_are_kept(tmp_path: pathlib.Path) -> None:
    checkpoints = Checkpoints(tmp_path, keep=2)
    for step in (1, 5, 20, 100):
        checkpoints.save_async(step, tree(step), {})
    checkpoints.wait()
    assert Checkpoints(tmp_path).steps() == [20, 100]
    assert_same(Checkpoints(tmp_path).restore(tree(0)).tree, tree(100))


def test_the_best_are_kept_beside_the_newest(tmp_path: pathlib.Path) -> None:
    def rank(metadata: Mapping[str, float]) -> float | None:
        return metadata.get("error")

    checkpoints = Checkpoints(tmp_path, keep=1, rank=rank, keep_best=2)
    for step, error in ((1, 3.0), (2, 1.0), (3, None), (4, 2.0), (5, 1.0), (6, None)):
        checkpoints.save(step, tree(step), {} if error is None else {"error": error})
    again = Checkpoints(tmp_path, keep=1, rank=rank)
    assert again.steps() == [2, 5, 6]
    assert again.best() == [5, 2]  # of equals the newest
    assert again.restore(tree(0)).step == 6
    flip_a_bit(tmp_path / "5")
    assert again.restore_part(tree(0), "", again.best()).step == 2


# Orbax leaves reads unfinished in a closed loop when one of them fails.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    "damage", [flip_a_bit, change_the_metadata, cut_short, empty_the_folder]
)
def test_damage_is_noticed_and_the_step_before_restored(
    tmp_path: pathlib.Path,
    caplog: pytest.LogCaptureFixture,
    damage: Callable[[pathlib.Path], None],
) -> None:
    checkpoints = Checkpoints(tmp_path)
    for step in (1, 2):
        checkpoints.save(step, tree(step), {"cursor": 123455 + step // 2})
    damage(tmp_path / "2")
    with caplog.at_level(logging.WARNING, checkpoint.__name__):
        restored = Checkpoints(tmp_path).restore(tree(0))
    assert (restored.step, restored.metadata) == (1, {"cursor": 123455})
    assert_same(restored.tree, tree(1))
    assert "DAMAGED CHECKPOINT" in caplog.text


def test_saving_goes_on_after_a_damaged_step(tmp_path: pathlib.Path) -> None:
    checkpoints = Checkpoints(tmp_path, keep=1)
    checkpoints.save(1, tree(1), {})
    Checkpoints(tmp_path, keep=2).save(9, tree(9), {})
    flip_a_bit(tmp_path / "9")
    assert checkpoints.restore(tree(0)).step == 1
    checkpoints.save(4, tree(4), {})
    assert_same(Checkpoints(tmp_path).restore(tree(0)).tree, tree(4))
    assert (tmp_path / "9.damaged").exists()
    checkpoints.save(9, tree(10), {})
    assert_same(Checkpoints(tmp_path).restore(tree(0)).tree, tree(10))


def test_a_step_behind_the_newest_is_refused(tmp_path: pathlib.Path) -> None:
    checkpoints = Checkpoints(tmp_path)
    checkpoints.save(3, tree(3), {})
    with pytest.raises(ValueError, match="step 2 is not after step 3"):
        checkpoints.save(2, tree(2), {})


def test_other_shapes_are_named_and_not_called_damage(tmp_path: pathlib.Path) -> None:
    Checkpoints(tmp_path).save(1, tree(1), {})
    other = tree(0) | {"half": jnp.zeros(6, jnp.bfloat16)}
    with pytest.raises(ValueError, match=r"half'\] is bfloat16\[5\] in it"):
        Checkpoints(tmp_path).restore(other)


def test_an_empty_directory_is_an_error(tmp_path: pathlib.Path) -> None:
    with pytest.raises(FileNotFoundError, match="no undamaged checkpoint"):
        Checkpoints(tmp_path / "none").restore(tree(0))


def test_values_that_are_no_arrays_are_refused(tmp_path: pathlib.Path) -> None:
    with pytest.raises(TypeError, match="got int for"):
        Checkpoints(tmp_path).save(1, {"cursor": 3}, {})


def test_a_save_that_fails_is_told_and_the_next_one_tries_again(
    tmp_path: pathlib.Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "full").write_text("no folder can be made here")
    checkpoints = Checkpoints(tmp_path / "full")
    with caplog.at_level(logging.WARNING, checkpoint.__name__):
        checkpoints.save_async(1, tree(1), {})
        checkpoints.save_async(2, tree(2), {})
    assert "update 1 was not saved in" in caplog.text
    with pytest.raises(checkpoint.SaveError, match="update 2 was not saved in"):
        checkpoints.wait()
    (tmp_path / "full").unlink()
    checkpoints.save(3, tree(3), {})
    assert Checkpoints(tmp_path / "full").steps() == [3]


def test_a_step_without_hashes_is_none(tmp_path: pathlib.Path) -> None:
    Checkpoints(tmp_path).save(1, tree(1), {})
    Checkpoints(tmp_path).save(2, tree(2), {})
    (tmp_path / "2.sha256").unlink()  # as if cut before them
    checkpoints = Checkpoints(tmp_path)
    assert checkpoints.restore(tree(0)).step == 1
    checkpoints.save(2, tree(5), {})
    assert_same(Checkpoints(tmp_path).restore(tree(0)).tree, tree(5))
    assert (tmp_path / "2.unfinished").exists()  # nothing is lost


def test_a_kill_while_saving_leaves_no_wrong_step(tmp_path: pathlib.Path) -> None:
    script = """
        import itertools, pathlib, sys
        import numpy as np
        from drivetrain.learners.checkpoint import Checkpoints
        checkpoints = Checkpoints(pathlib.Path(sys.argv[1]))
        for step in itertools.count(1):
            values = np.random.default_rng(step).integers(0, 2**32, 2**20, np.uint32)
            checkpoints.save_async(step, {"values": values}, {})
            print(step, flush=True)
    """
    command = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as saving:
        assert saving.stdout is not None
        while saving.stdout.readline().strip() != "5":
            pass
        saving.send_signal(signal.SIGKILL)
    restored = Checkpoints(tmp_path).restore({"values": np.zeros(2**20, np.uint32)})
    rng = np.random.default_rng(restored.step)
    expected = rng.integers(0, 2**32, 2**20, np.uint32)
    assert restored.step >= 4
    np.testing.assert_array_equal(restored.tree["values"], expected)


def test_a_resumed_run_equals_one_that_was_not_cut(tmp_path: pathlib.Path) -> None:
    optimizer = optim.adam(optim.OptimizerConfig(warmup_updates=5, decay_updates=50))
    sample = toy.sampler(toy.sign)
    config = CloningConfig(batch_size=8)
    learner = behavior_cloning(toy.linear_agent(), sample, optimizer, config)
    mesh = meshes.data_mesh()
    bank = meshes.shard(mesh, toy.bank(mesh.size))
    run = program.compile_program(learner, mesh, updates_per_call=10)

    state, _ = run(program.initial_state(learner, mesh, jax.random.key(0), bank), bank)
    Checkpoints(tmp_path).save(10, state, {})
    uncut, _ = run(state, bank)
    fresh = program.initial_state(learner, mesh, jax.random.key(1), bank)
    resumed, _ = run(Checkpoints(tmp_path).restore(fresh).tree, bank)
    assert_same(resumed, uncut)
