"""States a forecast: several trajectories, each with how likely and how sure it is."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..sim import geometry
from ..sim.records import Record


class Trajectories(Record):
    """A mixture of trajectories of one object, in its own pose at the time of asking.

    A step is (x, y, yaw): metres ahead, metres to the left and the turn since, so that
    zeros stand still. Given the mode, all numbers of all steps are independent normal
    variables (Nayakanti et al. 2022, section 3; the yaw is ours, for to drive a
    trajectory needs it). A yaw is compared the short way round.
    """

    logits: Float[Array, " modes"]
    mean: Float[Array, "modes steps 3"]  # m, m, rad
    scale: Float[Array, "modes steps 3"]  # standard deviations, positive

    def step_log_prob(
        self, target: Float[Array, "steps 3"]
    ) -> Float[Array, "modes steps"]:
        """Returns the logarithm of the density of each step, given the mode."""
        offset = target[None] - self.mean
        turn = geometry.wrap_angle(offset[..., 2])
        deviation = offset.at[..., 2].set(turn) / self.scale
        log_density = (
            -0.5 * deviation**2 - jnp.log(self.scale) - 0.5 * jnp.log(2 * jnp.pi)
        )
        return log_density.sum(axis=-1)

    def distance(
        self, target: Float[Array, "steps 3"], mask: Bool[Array, " steps"]
    ) -> Float[Array, " modes"]:
        """Returns how far each mode is from the target, mean of present steps [m].

        The nearest mode is the one that Wayformer's loss trains; zero if no step is
        present.
        """
        offset = jnp.where(mask[:, None], target[:, :2], 0.0)[None] - self.mean[..., :2]
        apart = jnp.where(mask[None], geometry.norm(offset), 0.0)
        return apart.sum(axis=1) / jnp.maximum(mask.sum(), 1)

    def mode(self) -> Float[Array, "steps 3"]:
        """Returns the centre of the most likely trajectory."""
        return self.mean[jnp.argmax(self.logits)]

    def probability(self) -> Float[Array, " modes"]:
        """Returns how likely each mode is."""
        return jax.nn.softmax(self.logits)
