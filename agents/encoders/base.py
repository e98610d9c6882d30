"""States what an encoder is: a network from one observation to one embedding."""

from collections.abc import Callable

from jaxtyping import Array, Float

from ...sim.observations.base import Observation

Encoder = Callable[[Observation], Float[Array, " width"]]
