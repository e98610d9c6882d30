"""Holds the speed of the current step along the logged way."""

import jax.numpy as jnp
from jaxtyping import Array, Int

from ..motion import Motion
from ..scene import Scene
from . import logged_path
from .base import Carry, SimAgent


def _step(
    scene: Scene, carry: Carry, motion: Motion, step: Int[Array, ""]
) -> tuple[Carry, Motion]:
    logged = scene.log_at(step + 1)
    return logged_path.advance(scene, carry, jnp.zeros_like(motion.yaw), logged)


CONSTANT_SPEED = SimAgent("constant_speed", logged_path.follow, _step)
