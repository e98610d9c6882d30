"""Blurs what is seen of others, as sensors do."""

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from ..motion import Motion


@dataclasses.dataclass(frozen=True, kw_only=True)
class NoiseConfig:
    """The standard deviations of the errors of an observation."""

    position: float = 0.0  # of x and of y [m]
    yaw: float = 0.0  # radians
    velocity: float = 0.0  # of each component [m/s]

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a standard deviation is negative or not finite.
        """
        for name, deviation in dataclasses.asdict(self).items():
            if not 0 <= deviation < math.inf:
                raise ValueError(
                    f"noise of {name} must be a standard deviation, 0 or more, got "
                    f"{deviation}."
                )


def blurred(
    config: NoiseConfig, motion: Motion, viewer: Int[Array, ""], key: PRNGKeyArray
) -> Motion:
    """Adds Gaussian errors to the poses and velocities of all but the viewer.

    Errors are independent between objects, axes and steps. They are drawn anew at each
    look, so a step that is seen again as history is seen with another error.

    Args:
        config: how large the errors are; none are drawn if all are 0.
        motion: of several steps, with a leading axis.
        viewer: the number of the object that looks; it knows its own motion.
        key: of the errors.
    """
    if config == NoiseConfig():
        return motion
    xy_key, yaw_key, velocity_key = jax.random.split(key, 3)
    is_other = (jnp.arange(motion.yaw.shape[-1]) != viewer)[None]

    def errors(key: PRNGKeyArray, deviation: float, *shape: int) -> Array:
        return deviation * jax.random.normal(key, (*motion.yaw.shape, *shape))

    xy = jnp.where(is_other[..., None], errors(xy_key, config.position, 2), 0.0)
    yaw = jnp.where(is_other, errors(yaw_key, config.yaw), 0.0)
    push = jnp.where(is_other[..., None], errors(velocity_key, config.velocity, 2), 0.0)
    return motion.replace(
        xyz=motion.xyz.at[..., :2].add(xy),
        yaw=motion.yaw + yaw,
        velocity=motion.velocity + push,
    )
