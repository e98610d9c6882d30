"""Lets every object do what it did in the log."""

from jaxtyping import Array, Int

from ..motion import Motion
from ..scene import Scene
from .base import Carry, SimAgent


def _reset(scene: Scene) -> Carry:
    del scene
    return ()


def _step(
    scene: Scene, carry: Carry, motion: Motion, step: Int[Array, ""]
) -> tuple[Carry, Motion]:
    del motion
    return carry, scene.log_at(step + 1)


PLAYBACK = SimAgent("playback", _reset, _step)
