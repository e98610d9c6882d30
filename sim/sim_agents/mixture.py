"""Lets several sim agents drive in one scene, each its own objects."""

from collections.abc import Callable, Sequence

from jaxtyping import Array, Bool, Int

from .. import motions
from ..motion import Motion
from ..scene import Scene
from .base import Carry, SimAgent

Mask = Callable[[Scene], Bool[Array, " objects"]]  # of the scene as an episode begins


def mixture(parts: Sequence[tuple[SimAgent, Mask]]) -> SimAgent:
    """Builds the sim agent.

    Args:
        parts: sim agents, each with the mask of the objects that it drives. An object
            that several claim belongs to the first; one that none claims does what the
            log says.
    """

    def reset(scene: Scene) -> Carry:
        masks, taken = [], ~scene.object_mask
        for _, mask_of in parts:
            masks.append(mask_of(scene) & ~taken)
            taken |= masks[-1]
        return tuple(agent.reset(scene) for agent, _ in parts), tuple(masks)

    def step(
        scene: Scene, carry: Carry, motion: Motion, step: Int[Array, ""]
    ) -> tuple[Carry, Motion]:
        memories, masks = carry
        moved, kept = scene.log_at(step + 1), []
        for (agent, _), memory, mask in zip(parts, memories, masks, strict=True):
            memory, driven = agent.step(scene, memory, motion, step)
            moved = motions.where(mask, driven, moved)
            kept.append(memory)
        return (tuple(kept), masks), moved

    return SimAgent("+".join(agent.name for agent, _ in parts), reset, step)
