"""States what a sim agent is: a rule that says where objects go next."""

import dataclasses
from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Int

from ..motion import Motion
from ..scene import Scene

Carry = Any  # what a sim agent remembers between steps, a pytree


@dataclasses.dataclass(frozen=True)
class SimAgent:
    """A pair of functions that drive all objects of a scenario.

    `reset(scene)` prepares an episode. `step(scene, carry, motion, step)` sees the
    world at a step and returns its memory and the motion of every object one step
    later.
    """

    name: str
    reset: Callable[[Scene], Carry]
    step: Callable[[Scene, Carry, Motion, Int[Array, ""]], tuple[Carry, Motion]]
