"""Lets objects do again what was recorded: motions, or actions."""

import jax
from jaxtyping import Array, Int

from ..dynamics.base import Action, Dynamics
from ..motion import Motion
from ..observations.base import View
from ..scene import Scene
from .base import Carry, SimAgent
from .learned import learned


def recorded_motions(motion: Motion) -> SimAgent:
    """Builds the sim agent that puts every object where it was.

    Args:
        motion: of the scenarios of the bank, with leading axes of scenarios and of
            their steps; after the last of these nobody is there.
    """

    def reset(scene: Scene) -> Carry:
        del scene
        return ()

    def step(
        scene: Scene, carry: Carry, before: Motion, step: Int[Array, ""]
    ) -> tuple[Carry, Motion]:
        del before
        place = scene.index, step + 1
        after = jax.tree.map(lambda leaf: leaf.at[place].get(mode="clip"), motion)
        is_recorded = step + 1 < motion.valid.shape[1]
        return carry, after.replace(valid=after.valid & is_recorded)

    return SimAgent("recorded", reset, step)


def recorded_actions(actions: Action, dynamics: Dynamics) -> SimAgent:
    """Builds the sim agent by which every object acts as it did.

    Args:
        actions: with leading axes of the scenarios of the bank, of their steps, and of
            objects; the action at a step leads to the next one. After the last step it
            is repeated.
        dynamics: of the actions.
    """

    def policy(view: View, number: Int[Array, ""]) -> Action:
        return actions.at[view.scene.index, view.step, number].get(mode="clip")

    return learned(policy, dynamics)
