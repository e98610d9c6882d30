"""Tests that no change to a folder goes unnoticed."""

import pathlib
import random
import shutil
import subprocess

import pytest

from drivetrain.learners import checksums


@pytest.fixture
def folder(tmp_path: pathlib.Path) -> pathlib.Path:
    """A folder of some files, of which one is empty, with its hashes beside it."""
    path = tmp_path / "7"
    (path / "deep" / "er").mkdir(parents=True)
    rng = random.Random(0)
    for name, size in {
        "a": 1,
        "deep/b": 500,
        "deep/er/c d": 40_000,
        "empty": 0,
    }.items():
        (path / name).write_bytes(rng.randbytes(size))
    checksums.write(path)
    return path


def files_of(folder: pathlib.Path) -> list[pathlib.Path]:
    """Returns the files of a folder, with that of its hashes, but empty ones."""
    files = [path for path in folder.parent.rglob("*") if path.is_file()]
    return sorted(path for path in files if path.stat().st_size)


def test_what_was_written_is_not_damaged(folder: pathlib.Path) -> None:
    assert checksums.exist(folder)
    assert checksums.damage(folder) is None


def test_sha256sum_checks_the_hashes_too(folder: pathlib.Path) -> None:
    command = ["sha256sum", "--check", "--strict", "7.sha256"]
    subprocess.run(command, cwd=folder.parent, check=True, capture_output=True)


@pytest.mark.parametrize("seed", range(40))
def test_a_flipped_bit_and_a_cut_are_noticed(folder: pathlib.Path, seed: int) -> None:
    rng = random.Random(seed)
    path = rng.choice(files_of(folder))
    content = bytearray(path.read_bytes())
    place = rng.randrange(len(content))
    if rng.random() < 0.5:
        content[place] ^= 1 << rng.randrange(8)
    else:
        del content[place:]
    path.write_bytes(content)
    assert checksums.damage(folder) is not None


def test_lacking_and_added_files_are_named(folder: pathlib.Path) -> None:
    (folder / "deep" / "b").unlink()
    assert checksums.damage(folder) == "7/deep/b is missing"
    (folder / "deep" / "b").write_bytes(b"another")
    assert checksums.damage(folder) == "the hash of 7/deep/b differs"
    (folder / "new").write_bytes(b"")
    assert checksums.damage(folder) == "7/new has no hash"


def test_a_folder_without_hashes_is_not_whole(folder: pathlib.Path) -> None:
    checksums.remove(folder)
    assert not checksums.exist(folder)
    assert "cannot be read" in str(checksums.damage(folder))
    shutil.rmtree(folder)
    assert "cannot be read" in str(checksums.damage(folder))
