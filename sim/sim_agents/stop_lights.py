"""Finds the red light at which an object has to stop on its way."""

import dataclasses
import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from .. import geometry
from ..scenario import LightState
from ..scene_records import Lights

STOPS = (LightState.STOP, LightState.ARROW_STOP)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LightConfig:
    """Which lights concern an object."""

    distance: float = 2.0  # metres from the way to the stop point, at most
    turn: float = math.pi / 4  # between the way and the lane, at most
    max_deceleration: float = 6.0  # m/s^2; a light that would take more is passed

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a parameter is not positive and finite.
        """
        for name, value in dataclasses.asdict(self).items():
            if not 0 < value < math.inf:
                raise ValueError(f"{name} of lights must be positive, got {value}.")


def gap(
    config: LightConfig,
    lights: Lights,
    way: Float[Array, "stations 2"],
    chord: float,
    front: Float[Array, ""],
    speed: Float[Array, ""],
) -> Float[Array, ""]:
    """Returns the distance from the front of an object to the first red light [m].

    A light concerns the object where the way passes its stop point along its lane and
    it shows stop. It does no more where the front is past the stop point, or could not
    come to rest before it. Lights whose lane is not in the map concern nobody.

    Args:
        config: which lights concern an object.
        lights: of the scenario, now.
        way: places at equal distances along the way, the object's first [m].
        chord: the distance between them along the way [m].
        front: from the object's centre [m].
        speed: of the object [m/s].

    Returns:
        The distance, infinite without such a light.
    """
    start, along = way[:-1, None], jnp.diff(way, axis=0)[:, None]
    stop = lights.xyz[None, :, :2]
    share = geometry.nearest_on_segment(stop, start, start + along)
    aside = geometry.norm(stop - start - share[..., None] * along)
    is_red = jnp.isin(lights.state, jnp.array(STOPS)) & lights.has_lane
    ahead = geometry.dot(along, geometry.direction(lights.yaw)[None])
    agrees = ahead > math.cos(config.turn) * geometry.norm(along)
    passes = is_red[None] & agrees & (aside <= config.distance)

    # The nearest chord of each light: the ends of those beside it are near as well.
    nearest = jnp.argmin(jnp.where(passes, aside, jnp.inf), axis=0)
    reached = chord * (nearest + jnp.take_along_axis(share, nearest[None], axis=0)[0])
    distance = reached - front
    in_time = speed**2 <= 2 * config.max_deceleration * distance
    concerns = jnp.any(passes, axis=0) & (distance > 0) & in_time
    return jnp.min(jnp.where(concerns, distance, jnp.inf))
