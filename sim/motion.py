"""States how objects move: the part of a world that changes."""

from jaxtyping import Array, Bool, Float

from . import geometry
from .records import Record


class Motion(Record):
    """Pose and velocity of objects at one step, in the scenario's frame.

    The frame of a scenario is the map frame of its file, moved so that the ego stands
    in the origin at the current step.
    """

    xyz: Float[Array, "objects 3"]  # centre of the box [m]
    yaw: Float[Array, " objects"]  # radians in [-pi, pi]
    velocity: Float[Array, "objects 2"]  # metres per second
    valid: Bool[Array, " objects"]  # where False, the other fields are zero

    @property
    def xy(self) -> Float[Array, "*objects 2"]:
        """The position in the plane [m]."""
        return self.xyz[..., :2]

    @property
    def speed(self) -> Float[Array, "*objects"]:
        """The length of the velocity [m/s], with a finite gradient at rest."""
        return geometry.norm(self.velocity)
