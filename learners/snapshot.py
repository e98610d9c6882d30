"""Writes a tree of arrays into a folder, in Orbax's format, and reads it back.

Orbax commits a folder by renaming it: a write that is cut leaves none. With several
processes each writes what it holds. Nothing that is read is executed.
"""

import json
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree
from orbax.checkpoint import v1 as orbax

Tree = PyTree  # of arrays of JAX or NumPy


def write_async(
    folder: pathlib.Path, tree: Tree, metadata: Mapping[str, Any]
) -> Callable[[], None]:
    """Copies the arrays to the host, and writes them while the caller goes on.

    Args:
        folder: which is not there yet.
        tree: arrays; its structure itself is not written.
        metadata: values that JSON can hold.

    Returns:
        A function that waits until all is written, and raises what went wrong.

    Raises:
        TypeError: if a leaf is no array, or JSON cannot hold the metadata.
    """
    text = json.dumps(metadata)
    # Orbax refuses empty arrays.
    arrays = {n: _kept(leaf) for n, leaf in _named(tree).items() if leaf.size}
    saving = orbax.save_async(str(folder), arrays, custom_metadata={"metadata": text})
    return saving.result


def metadata(folder: pathlib.Path) -> dict[str, Any]:
    """Returns the metadata of a folder."""
    saved: Any = orbax.metadata(str(folder)).custom_metadata
    return json.loads(saved["metadata"])


def read(folder: pathlib.Path, like: Tree, prefix: str = "") -> Tree:
    """Returns a part of the tree in a folder.

    Args:
        folder: of the tree.
        like: of the structure, shapes and types of the part; each array is put where
            the one here is.
        prefix: with which the names of its arrays begin, such as `.params`.

    Raises:
        ValueError: if the part holds other arrays than `like`.
    """
    named = _named(like)
    wanted = {prefix + name: leaf for name, leaf in named.items() if leaf.size}
    there: Any = orbax.metadata(str(folder)).metadata
    part = {name for name in there if name.startswith(prefix)}
    for name in sorted(wanted.keys() | part):
        ours, saved = (
            f"{a[name].dtype}{list(a[name].shape)}" if name in a else "nothing"
            for a in (wanted, there)
        )
        if ours != saved:
            raise ValueError(
                f"the checkpoint does not fit: {name.removeprefix(prefix)} is {saved} "
                f"in it and {ours} here; use the config that was saved beside it."
            )
    loaded = orbax.load(
        str(folder),
        {name: _abstract(wanted[name]) if name in wanted else ... for name in there},
    )

    def place(leaf: Array | np.ndarray, name: str) -> Array | np.ndarray:
        if not leaf.size:
            return leaf
        # The program donates its arguments: they must not share memory with the host.
        found = _kept(loaded[prefix + name])
        if _is_key(leaf):
            return jax.random.wrap_key_data(
                jnp.asarray(found), impl=jax.random.key_impl(leaf)
            )
        return found

    leaves, structure = jax.tree.flatten(like)
    return jax.tree.unflatten(structure, map(place, leaves, named))


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


def _kept(leaf: Array | np.ndarray) -> Array | np.ndarray:
    """Returns an array that stays as it is while it is written.

    From other devices than CPUs Orbax copies before the program may reuse the memory.
    """
    if isinstance(leaf, np.ndarray):
        return leaf.copy()
    is_on_cpu = next(iter(leaf.sharding.device_set)).platform == "cpu"
    return jnp.copy(leaf) if is_on_cpu else leaf


def _abstract(leaf: Array | np.ndarray) -> jax.ShapeDtypeStruct | np.ndarray:
    if isinstance(leaf, np.ndarray):
        return leaf
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=leaf.sharding)
