"""Measures how far an object is from where it was in the log (W 3.4)."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from .. import geometry
from .base import Measure, Metric, Moment


def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns the planar distance to the logged position [m], where both are valid."""
    after, logged = moment.after, moment.logged
    valid = after.valid[number] & logged.valid[number]
    distance = geometry.norm(after.xy[number] - logged.xy[number])
    return Measure(value=jnp.where(valid, distance, 0.0), valid=valid)


DISPLACEMENT = Metric("log_displacement", False, measure)
