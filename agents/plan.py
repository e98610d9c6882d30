"""States a plan: the next actions, which are taken one by one without looking."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from ..sim import geometry, pytrees
from ..sim.dynamics.delta import delta
from ..sim.records import Record
from .trajectories import Trajectories

# What a plan's actions are: steps ahead, to the left and about, in one's own pose.
ACTION_SPEC = delta("local").action_spec


class Plan(Record):
    """Actions to take, and how many of them are taken."""

    actions: Float[Array, "steps 3"]  # m, m, rad
    num_taken: Int[Array, ""]

    def is_done(self) -> Array:
        """Tells whether no action is left."""
        return self.num_taken >= self.actions.shape[0]

    def follow(self) -> tuple["Plan", Float[Array, " 3"]]:
        """Takes the next action."""
        return self.replace(num_taken=self.num_taken + 1), self.actions[self.num_taken]


class Planned(Record):
    """The policy of whoever follows a plan: one action, and nothing to explore."""

    action: Float[Array, " 3"]
    forecast: Trajectories  # what a plan made at this very step is made from

    def sample(self, key: Key[Array, ""]) -> Float[Array, " 3"]:
        """Returns the action, whatever the key."""
        del key
        return self.action

    def mode(self) -> Float[Array, " 3"]:
        """Returns the action."""
        return self.action


def none_yet(num_steps: int) -> Plan:
    """Returns a plan of some steps of which none is left."""
    return Plan(actions=jnp.zeros((num_steps, 3)), num_taken=jnp.int32(num_steps))


def along(poses: Float[Array, "steps 3"]) -> Plan:
    """Plans to be in one pose after the other.

    Each action is the difference of two poses, seen from the first of them; the pose
    before all is the present one, zero:

        (dx, dy)_t = R(-yaw_t-1) ((x, y)_t - (x, y)_t-1),    dyaw_t = yaw_t - yaw_t-1
    """
    before = jnp.concatenate([jnp.zeros((1, 3)), poses[:-1]])
    shift = geometry.to_frame(poses[:, :2] - before[:, :2], before[:, 2])
    turn = geometry.wrap_angle(poses[:, 2] - before[:, 2])
    return Plan(
        actions=jnp.concatenate([shift, turn[:, None]], axis=-1),
        num_taken=jnp.int32(0),
    )


def continued(plan: Plan, fresh: Plan) -> tuple[Plan, Float[Array, " 3"]]:
    """Takes the next action of a plan, or the first of a fresh one if it is done."""
    return pytrees.where(plan.is_done(), fresh, plan).follow()
