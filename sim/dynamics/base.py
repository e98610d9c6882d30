"""States what dynamics are: how an action moves an object, and the way back.

All functions work elementwise over the leading axes of their arguments, so they
serve one object as well as all objects of a scenario.
"""

import dataclasses
from collections.abc import Callable

from jaxtyping import Array, Float, Int

from ..motion import Motion

Duration = float | Float[Array, ""]  # seconds
Action = Float[Array, "*objects features"] | Int[Array, "*objects"]
Size = Float[Array, "*#objects 3"]  # length, width and height [m]


@dataclasses.dataclass(frozen=True)
class Continuous:
    """Actions are vectors; a policy chooses them between the bounds."""

    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class Discrete:
    """Actions are integers from 0 to `num_actions - 1`."""

    num_actions: int
    bins: tuple[int, ...] = ()  # of what the numbers stand for; their product


ActionSpec = Continuous | Discrete


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """A pair of functions between motions and actions.

    `forward(motion, size, action, dt)` is the motion one step later; height and
    validity stay as they are, since the environment takes them from the log.
    `inverse(before, after, size, dt)` is the action that leads from one motion to the
    other as nearly as the dynamics can. `coast(motion, dt)` is the action that holds
    velocity and heading. `controls(action)` are the numbers that an action stands for.
    """

    name: str
    action_spec: ActionSpec
    forward: Callable[[Motion, Size, Action, Duration], Motion]
    inverse: Callable[[Motion, Motion, Size, Duration], Action]
    coast: Callable[[Motion, Duration], Action]
    controls: Callable[[Action], Float[Array, "*objects features"]]
