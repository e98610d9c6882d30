"""Says which objects of a scenario a team controls."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .. import geometry
from ..metrics.build import EGO
from ..scenario import ObjectType
from ..scene import Scene
from .base import Controls


def ego(scene: Scene) -> Bool[Array, " objects"]:
    """Returns the mask of the ego."""
    mask = scene.object_mask
    return mask & (jnp.arange(len(mask)) == EGO)


def everyone(scene: Scene) -> Bool[Array, " objects"]:
    """Returns the mask of all objects."""
    return scene.object_mask


def of_type(*kinds: ObjectType) -> Controls:
    """Builds the set of all objects of some types.

    Pedestrians and cyclists want other dynamics than cars: give each its team.
    """

    def controls(scene: Scene) -> Bool[Array, " objects"]:
        is_kind = scene.object_type[:, None] == jnp.array(kinds)[None]
        return scene.object_mask & jnp.any(is_kind, axis=1)

    return controls


vehicles = of_type(ObjectType.VEHICLE)
pedestrians = of_type(ObjectType.PEDESTRIAN)
cyclists = of_type(ObjectType.CYCLIST)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MovingConfig:
    """Which vehicles Nocturne hands to its agents (N 4.1)."""

    min_speed: float = 0.05  # metres per second, exceeded at some logged step
    min_distance: float = 0.2  # metres to the goal, exceeded at the start
    max_objects: int = 20  # the first ones; the bank sorts by importance to the ego

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a threshold is negative, or nobody would be controlled.
        """
        for name, least in (("min_speed", 0), ("min_distance", 0), ("max_objects", 1)):
            if not getattr(self, name) >= least:
                raise ValueError(
                    f"{name} must be at least {least}, got {getattr(self, name)}."
                )


def moving_vehicles(config: MovingConfig = MovingConfig()) -> Controls:
    """Builds the set of the vehicles that are there at the start, move and could.

    A vehicle moves if it is ever faster than a speed or starts farther from its goal
    than a distance. It could if the log itself reaches the goal on the road (N app. E).
    """

    def controls(scene: Scene) -> Bool[Array, " objects"]:
        start = scene.log_at(scene.current_step)
        log = jax.vmap(scene.log_at)(jnp.arange(scene.bank.sizes.num_steps))
        moves = jnp.max(log.speed, axis=0) > config.min_speed
        away = geometry.norm(scene.log_end().xy - start.xy) > config.min_distance
        mask = vehicles(scene) & start.valid & scene.goal_feasible & (moves | away)
        return mask & (jnp.cumsum(mask) <= config.max_objects)

    return controls
