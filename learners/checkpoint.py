"""Saves and restores checkpoints: arrays of any tree and metadata, with a hash of both.

The format on disk is Orbax's, which commits a step by renaming its folder: a save cut
short leaves no step. What Orbax does not notice (a flipped bit) the hash does.
"""

import dataclasses
import hashlib
import json
import logging
import pathlib
import shutil
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree
from orbax.checkpoint import v1 as orbax

logger = logging.getLogger(__name__)

Tree = PyTree  # of arrays of JAX or NumPy


class DamagedError(Exception):
    """A checkpoint that is not what was saved."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Restored:
    """What a checkpoint held."""

    step: int
    tree: Tree
    metadata: dict[str, Any]


class Checkpoints:
    """The checkpoints of one run: a directory with one folder per step.

    Any number of processes may read; one may write.
    """

    def __init__(self, directory: pathlib.Path, keep: int = 3):
        """Opens a directory, which need not exist yet.

        Args:
            directory: where the folders are.
            keep: how many of the newest to keep.

        Raises:
            ValueError: if none were to be kept.
        """
        if keep < 1:
            raise ValueError(f"keep must be at least 1, got {keep}.")
        self._directory = directory.absolute()
        self._keep = keep
        self._damaged: set[int] = set()
        self._pending: orbax.AsyncResponse[None] | None = None

    def steps(self) -> list[int]:
        """Lists the steps that were saved and not found damaged, in order."""
        if not self._directory.exists():
            return []
        names = [path.name for path in self._directory.iterdir()]
        return sorted({int(n) for n in names if n.isdecimal()} - self._damaged)

    def saved(self) -> list[int]:
        """Lists the steps when no save is under way any more, as `steps` does."""
        self.wait()
        return self.steps()

    def save(self, step: int, tree: Tree, metadata: Mapping[str, Any]) -> None:
        """Saves a step and returns when it is on disk; raises as `save_async` does."""
        self.save_async(step, tree, metadata)
        self.wait()

    def save_async(self, step: int, tree: Tree, metadata: Mapping[str, Any]) -> None:
        """Copies the arrays to the host, and writes them while the caller goes on.

        A save under way is waited for. Steps that `restore` found damaged are renamed
        to `STEP.damaged`, so that they do not stand before what is saved now.

        Args:
            step: after every step saved before.
            tree: arrays; its structure itself is not saved.
            metadata: values that JSON can hold.

        Raises:
            ValueError: if the step is not after the newest one.
            TypeError: if a leaf is no array, or JSON cannot hold the metadata.
        """
        self.wait()
        newest = max(self.steps(), default=-1)
        if step <= newest:
            raise ValueError(
                f"step {step} is not after step {newest}, the newest in "
                f"{self._directory}; restore it first, or save to another directory."
            )
        text = json.dumps(metadata)
        # Copies, as the program may reuse the buffers. Orbax refuses empty arrays.
        arrays = {n: np.array(leaf) for n, leaf in _named(tree).items() if leaf.size}
        self._directory.mkdir(parents=True, exist_ok=True)
        self._set_damaged_aside()
        self._pending = orbax.save_async(
            str(self._directory / str(step)),
            arrays,
            custom_metadata={"metadata": text, "sha256": _digest(arrays, text)},
        )

    def wait(self) -> None:
        """Waits for the save under way, if any, then deletes what is not kept."""
        if self._pending is None:
            return
        pending, self._pending = self._pending, None
        pending.result()
        for step in self.steps()[: -self._keep]:
            shutil.rmtree(self._directory / str(step))
        for unfinished in self._directory.glob("*.orbax-checkpoint-tmp*"):
            shutil.rmtree(unfinished)

    def metadata(self) -> dict[str, Any] | None:
        """Returns what the newest step says of itself, before its hash is checked.

        None if there is no step, or it says nothing that can be read.
        """
        self.wait()
        for step in self.steps()[-1:]:
            try:
                saved: Any = orbax.metadata(str(self._directory / str(step)))
                return json.loads(saved.custom_metadata["metadata"])
            except Exception:  # whatever a reader meets in damaged bytes
                return None
        return None

    def restore(self, like: Tree) -> Restored:
        """Restores the newest step that is what was saved; warns of each that is not.

        Args:
            like: a tree of the same structure, shapes and types, such as a fresh train
                state; each array is put where the one here is.

        Raises:
            FileNotFoundError: if there is no undamaged step.
            ValueError: if the step holds other arrays than `like`.
        """
        return self.restore_part(like, "")

    def restore_part(self, like: Tree, prefix: str) -> Restored:
        """Restores a part of the tree that was saved, and leaves the rest.

        Args:
            like: of the structure, shapes and types of the part.
            prefix: with which its arrays begin, such as `.params`.

        Raises:
            FileNotFoundError: if there is no undamaged step.
            ValueError: if the part of the step holds other arrays than `like`.
        """
        self.wait()
        for step in reversed(self.steps()):
            path = self._directory / str(step)
            try:
                arrays, metadata = _read(path)
            except DamagedError as error:
                self._damaged.add(step)
                logger.warning(
                    "DAMAGED CHECKPOINT: %s is not what was saved (%s); falling back "
                    "to the step before it.",
                    path,
                    error,
                )
                continue
            part = {
                name.removeprefix(prefix): array
                for name, array in arrays.items()
                if name.startswith(prefix)
            }
            return Restored(step=step, tree=_like(like, part), metadata=metadata)
        raise FileNotFoundError(f"no undamaged checkpoint in {self._directory}.")

    def _set_damaged_aside(self) -> None:
        for step in sorted(self._damaged):
            aside = self._directory / f"{step}.damaged"
            shutil.rmtree(aside, ignore_errors=True)
            (self._directory / str(step)).rename(aside)
        self._damaged.clear()


def _named(tree: Tree) -> dict[str, Array | np.ndarray]:
    named = {}
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        name = jax.tree_util.keystr(path)
        if not isinstance(leaf, jax.Array | np.ndarray):
            raise TypeError(
                f"a checkpoint holds arrays, got {type(leaf).__name__} for {name}; put "
                f"other values into the metadata."
            )
        if _is_key(leaf):
            name = f"{name} ({jax.random.key_impl(leaf)} key)"
            leaf = jax.random.key_data(leaf)
        named[name] = leaf
    return named


def _is_key(leaf: Array | np.ndarray) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _digest(arrays: Mapping[str, np.ndarray], metadata: str) -> str:
    digest = hashlib.sha256(metadata.encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"\n{name} {array.dtype} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _read(path: pathlib.Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    try:
        saved: Any = orbax.metadata(str(path)).custom_metadata
        text, expected = saved["metadata"], saved["sha256"]
        arrays = {name: np.asarray(x) for name, x in orbax.load(str(path)).items()}
    except MemoryError:  # says nothing about the checkpoint
        raise
    except Exception as error:  # whatever a reader meets in damaged bytes
        # Storage errors quote their whole specification.
        raise DamagedError(f"it cannot be read: {str(error)[:200]}") from error
    if _digest(arrays, text) != expected:
        raise DamagedError("its hash differs")
    return arrays, json.loads(text)


def _like(like: Tree, arrays: Mapping[str, np.ndarray]) -> Tree:
    def place(leaf: Array | np.ndarray, name: str) -> Array | np.ndarray:
        if not leaf.size:
            return leaf
        array = arrays[name]
        if isinstance(leaf, np.ndarray):
            return array
        if _is_key(leaf):
            bits = jnp.asarray(array)
            array = jax.random.wrap_key_data(bits, impl=jax.random.key_impl(leaf))
        # The program donates its arguments: they must not share memory with the host.
        return jax.device_put(array, leaf.sharding, may_alias=False)

    named = _named(like)
    wanted = {name: leaf for name, leaf in named.items() if leaf.size}
    for name in sorted(wanted.keys() | arrays.keys()):
        here, there = (
            f"{a[name].dtype}{list(a[name].shape)}" if name in a else "nothing"
            for a in (wanted, arrays)
        )
        if here != there:
            raise ValueError(
                f"the checkpoint does not fit: {name} is {there} in it and {here} "
                f"here; use the config that was saved beside it."
            )
    leaves, structure = jax.tree.flatten(like)
    return jax.tree.unflatten(structure, map(place, leaves, named))
