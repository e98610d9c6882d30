"""Tells whether an object runs a red light (`definitions.md` section 3)."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .. import geometry
from ..motion import Motion
from ..scenario import SAME_LEVEL, LightState
from .base import Measure, Metric, Moment

LANE_HALF_WIDTH = 1.75  # metres beside the stop point; the next lane is another light's
HEADING_TOLERANCE = jnp.pi / 4  # radians off the lane; crossing traffic is at a half pi


def _shows_stop(state: Int[Array, " lights"]) -> Bool[Array, " lights"]:
    """Tells what forbids to go on; flashing red allows it after a stop."""
    return (state == LightState.STOP) | (state == LightState.ARROW_STOP)


def _front(motion: Motion, length: Float[Array, ""], number: Int[Array, ""]):
    return motion.xy[number] + length / 2 * geometry.direction(motion.yaw[number])


def measure(moment: Moment, number: Int[Array, ""]) -> Measure:
    """Returns 1 where the front crosses the stop line of a red light along its lane.

    The line stands across the lane at the stop point, and reaches 1.75 m to either
    side: half a lane. The middle of the box's front passes it during the step, from
    before it or on it to beyond it, with the yaw after the step within 45 degrees of
    the lane's direction, at the height of the lane. The light shows stop or arrow stop
    at both ends of the step: whoever passes while it changes is not to blame. Lights
    whose lane is not in the map have no direction and are passed over. Lanes that part
    at one stop point share its line. Valid where the object was there before and after
    the step.
    """
    scene, before, after = moment.scene, moment.before, moment.after
    lights, earlier = scene.lights_at(moment.step), scene.lights_at(moment.step - 1)
    is_red = lights.has_lane & _shows_stop(lights.state) & _shows_stop(earlier.state)

    length = moment.object_size[number, 0]
    stop, lane = lights.xyz[:, :2], geometry.direction(lights.yaw)
    front_t = _front(before, length, number)[None] - stop
    front_tp1 = _front(after, length, number)[None] - stop
    along_t, along_tp1 = geometry.dot(front_t, lane), geometry.dot(front_tp1, lane)
    crosses = (along_t <= 0) & (along_tp1 > 0)
    share = along_t / jnp.where(crosses, along_t - along_tp1, -1.0)
    aside = geometry.cross(lane, front_t + share[:, None] * (front_tp1 - front_t))
    crosses &= jnp.abs(aside) <= LANE_HALF_WIDTH

    turn = geometry.wrap_angle(after.yaw[number, None] - lights.yaw)
    crosses &= jnp.abs(turn) <= HEADING_TOLERANCE
    crosses &= jnp.abs(after.xyz[number, 2] - lights.xyz[:, 2]) <= SAME_LEVEL

    valid = before.valid[number] & after.valid[number]
    runs = jnp.any(crosses & is_red) & valid
    return Measure(value=runs.astype(jnp.float32), valid=valid)


RED_LIGHT = Metric("red_light", False, measure)
