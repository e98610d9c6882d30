"""Turns places, directions and velocities into the frame of the ego."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import geometry
from ..records import Record

# Networks see lengths in units of 20 m, speeds of 10 m/s and sizes of 5 m, so that most
# values lie between -1 and 1.
LENGTH_UNIT = 20.0
SPEED_UNIT = 10.0
SIZE_UNIT = 5.0


class EgoFrame(Record):
    """The pose of the ego: x points forward, y to the left."""

    xy: Float[Array, " 2"]  # metres
    yaw: Float[Array, ""]  # radians

    def place(self, xy: Float[Array, "*things 2"]) -> Float[Array, "*things 2"]:
        """Returns map positions as seen by the ego, in length units."""
        offset = xy - jnp.broadcast_to(self.xy, xy.shape)
        return geometry.to_frame(offset, self.yaw) / LENGTH_UNIT

    def heading(self, yaw: Float[Array, "*things"]) -> Float[Array, "*things 2"]:
        """Returns the cosine and sine of yaws relative to the ego's."""
        return geometry.direction(yaw - self.yaw)

    def velocity(
        self, velocity: Float[Array, "*things 2"]
    ) -> Float[Array, "*things 2"]:
        """Returns map velocities along the ego's axes, in speed units."""
        return geometry.to_frame(velocity, self.yaw) / SPEED_UNIT


def stack(*features: Array) -> Array:
    """Joins features along the last axis; those without one become columns."""
    ndim = max(feature.ndim for feature in features)
    columns = [f if f.ndim == ndim else f[..., None] for f in features]
    return jnp.concatenate(columns, axis=-1)
