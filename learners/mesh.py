"""Lays out devices in one row, and arrays over them."""

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, PyTree

AXIS = "data"


def data_mesh() -> Mesh:
    """Makes a mesh of one axis, `data`, over all devices of all processes."""
    devices = jax.devices()
    return jax.make_mesh(
        (len(devices),), (AXIS,), axis_types=(AxisType.Auto,), devices=devices
    )


def own_places(mesh: Mesh) -> list[int]:
    """Returns the places in the mesh of the devices of this process."""
    here = set(mesh.local_devices)
    return [place for place, device in enumerate(mesh.devices) if device in here]


def is_first() -> bool:
    """Tells whether this process is the one that speaks for all."""
    return jax.process_index() == 0


def largest(values: np.ndarray) -> np.ndarray:
    """Returns the largest of each of some values among all processes.

    Where one process knows a value and the others have 0, it is told to all.
    """
    if jax.process_count() == 1:
        return values
    return np.max(multihost_utils.process_allgather(values), axis=0)


def gathered(text: str) -> list[str]:
    """Returns the texts of all processes, in their order."""
    if jax.process_count() == 1:
        return [text]
    own = np.frombuffer(text.encode(), np.uint8)
    padded = np.zeros(largest(np.array(own.size)), np.uint8)
    padded[: own.size] = own
    rows = multihost_utils.process_allgather(padded)
    return [row.tobytes().rstrip(b"\0").decode() for row in rows]


def replicate(mesh: Mesh, tree: PyTree[Array | np.ndarray]) -> PyTree[Array]:
    """Puts a copy of every array, the same in all processes, on each device."""
    everywhere = NamedSharding(mesh, PartitionSpec())
    # By a program: device_put does not reach the devices of other processes with keys.
    return jax.jit(lambda tree: tree, out_shardings=everywhere)(tree)


def shard(mesh: Mesh, tree: PyTree[Array | np.ndarray]) -> PyTree[Array]:
    """Puts entry i of every array's leading axis on device i of this process.

    Raises:
        ValueError: if a leading axis is not as long as this process has devices.
    """
    num_here = len(own_places(mesh))
    by_device = NamedSharding(mesh, PartitionSpec(AXIS))
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        if leaf.shape[:1] != (num_here,):
            raise ValueError(
                f"the leading axis of a sharded array must be the {num_here} devices, "
                f"got shape {leaf.shape} for {jax.tree_util.keystr(path)}."
            )

    def put(leaf: Array | np.ndarray) -> Array:
        shape = (mesh.size, *leaf.shape[1:])
        return jax.make_array_from_process_local_data(
            by_device, np.asarray(leaf), shape
        )

    return jax.tree.map(put, tree)
