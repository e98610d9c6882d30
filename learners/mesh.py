"""Lays out devices in one row, and arrays over them."""

import jax
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, PyTree

AXIS = "data"


def data_mesh() -> Mesh:
    """Makes a mesh of one axis, `data`, over all devices of this process."""
    devices = jax.local_devices()
    return jax.make_mesh(
        (len(devices),), (AXIS,), axis_types=(AxisType.Auto,), devices=devices
    )


def replicate(mesh: Mesh, tree: PyTree[Array | np.ndarray]) -> PyTree[Array]:
    """Puts a copy of every array on each device."""
    return jax.device_put(tree, NamedSharding(mesh, PartitionSpec()))


def shard(mesh: Mesh, tree: PyTree[Array | np.ndarray]) -> PyTree[Array]:
    """Puts entry i of every array's leading axis on device i.

    Raises:
        ValueError: if a leading axis is not as long as the mesh.
    """
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        if leaf.shape[:1] != (mesh.size,):
            raise ValueError(
                f"the leading axis of a sharded array must be the {mesh.size} devices, "
                f"got shape {leaf.shape} for {jax.tree_util.keystr(path)}."
            )
    return jax.device_put(tree, NamedSharding(mesh, PartitionSpec(AXIS)))
