"""Finds the points of the map that a viewer sees: by C++ on CPUs, else in plain JAX."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from .. import map_search
from ..box_search import Boxes
from ..data.parts import POLYGONS
from ..native import library
from ..scenario import MapType
from ..scene import Scene
from .visibility import Cone, nearest_visible_points

Chosen = tuple[Int[Array, " chosen"], Bool[Array, " chosen"]]


def visible_road(scene: Scene, hiding: Boxes, cone: Cone, count: int) -> Chosen:
    """Finds the nearest points of the map, but for stop signs, that no box hides.

    Args:
        scene: whose map it is.
        hiding: what hides points, as in `nearest_visible_points`.
        cone: in which the viewer looks.
        count: how many to choose.

    Returns:
        The numbers of the points among `scene.map_points`, nearest first, and their
        mask.
    """
    find = library.on_cpu(visible_natively, visible_plainly, count=count)
    return find(scene, hiding, cone)


def visible_natively(scene: Scene, hiding: Boxes, cone: Cone, count: int) -> Chosen:
    """Asks the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_visible_points",
        [
            jax.ShapeDtypeStruct((count,), jnp.int32),
            jax.ShapeDtypeStruct((), jnp.int32),
        ],
        vmap_method="expand_dims",
    )
    number, found = call(
        cone.operand(),
        *hiding.operands(),
        *map_search.map_operands(scene.bank, scene.index),
        left_out=_bits([MapType.STOP_SIGN]),
        closed=_bits(POLYGONS),
    )
    return number, jnp.arange(count) < found


def visible_plainly(scene: Scene, hiding: Boxes, cone: Cone, count: int) -> Chosen:
    """Asks in plain JAX, on any device."""
    points = scene.map_points(jnp.arange(scene.bank.sizes.num_vertices))
    present = points.valid & (points.map_type != MapType.STOP_SIGN)
    return nearest_visible_points(points.xyz[:, :2], present, hiding, cone, count)


def _bits(types) -> np.int32:
    """Returns a set of map types as a number: bit i stands for type i."""
    return np.int32(sum(1 << kind for kind in types))
