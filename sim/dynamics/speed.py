"""Says how fast an object drives along its heading."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import geometry
from ..motion import Motion


def signed_speed(motion: Motion) -> Float[Array, "*objects"]:
    """Returns the length of the velocity [m/s], negative where it points backwards.

    The length, and not the part along the heading: what slips in a log is as fast as
    its velocity.
    """
    along = geometry.dot(motion.velocity, geometry.direction(motion.yaw))
    return jnp.where(along < 0, -motion.speed, motion.speed)
