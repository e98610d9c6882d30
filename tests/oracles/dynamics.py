"""Oracle of the dynamics: Waymax paper A.1, Nocturne paper D, and uniform bins.

Written from `definitions.md` section 2 alone, for one object, in float64.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from . import geometry

MAX_ACCELERATION = 6.0  # metres per second squared
MAX_CURVATURE = 0.3  # 1 / metre
MIN_DISTANCE = 1e-3  # metres; over less than this a curvature cannot be told


class State(NamedTuple):
    """Pose and velocity of one object in the map frame."""

    x: float  # metres
    y: float  # metres
    yaw: float  # radians
    vx: float  # metres per second
    vy: float  # metres per second


def delta_forward(
    state: State, dx: float, dy: float, dyaw: float, dt: float, *, local: bool
) -> State:
    """Moves an object by a difference of poses (equation 1).

        x' = x + dx, y' = y + dy, yaw' = yaw + dyaw, v' = (x' - x, y' - y) / dt

    Args:
        state: before the step.
        dx: forward if local, else along x of the map [m].
        dy: to the left if local, else along y of the map [m].
        dyaw: turn to the left [rad].
        dt: length of the step [s].
        local: whether dx and dy are in the frame of the object before the step.
    """
    if local:
        cos, sin = math.cos(state.yaw), math.sin(state.yaw)
        dx, dy = cos * dx - sin * dy, sin * dx + cos * dy
    yaw = geometry.wrap_angle(state.yaw + dyaw)
    return State(state.x + dx, state.y + dy, yaw, dx / dt, dy / dt)


def delta_inverse(
    before: State, after: State, *, local: bool
) -> tuple[float, float, float]:
    """Returns the (dx, dy, dyaw) that `delta_forward` needs between two states."""
    dx, dy = after.x - before.x, after.y - before.y
    if local:
        cos, sin = math.cos(before.yaw), math.sin(before.yaw)
        dx, dy = cos * dx + sin * dy, -sin * dx + cos * dy
    return dx, dy, geometry.wrap_angle(after.yaw - before.yaw)


def signed_speed(state: State) -> float:
    """Returns the length of the velocity, negative where it points backwards [m/s]."""
    along = state.vx * math.cos(state.yaw) + state.vy * math.sin(state.yaw)
    return math.copysign(math.hypot(state.vx, state.vy), -1.0 if along < 0 else 1.0)


def bicycle_forward(
    state: State, acceleration: float, curvature: float, dt: float
) -> State:
    """Advances an object by the bicycle (equation 2).

        x' = x + vx dt + a cos(yaw) dt^2 / 2, and y' alike with sin
        yaw' = yaw + k (v dt + a dt^2 / 2)
        v' = v + a dt, along yaw'

    Args:
        state: before the step; v is its signed speed.
        acceleration: clipped to +-6 m/s^2.
        curvature: clipped to +-0.3 1/m.
        dt: length of the step [s].
    """
    a = min(max(acceleration, -MAX_ACCELERATION), MAX_ACCELERATION)
    k = min(max(curvature, -MAX_CURVATURE), MAX_CURVATURE)
    v = signed_speed(state)

    x = state.x + state.vx * dt + a * math.cos(state.yaw) * dt**2 / 2
    y = state.y + state.vy * dt + a * math.sin(state.yaw) * dt**2 / 2
    yaw = geometry.wrap_angle(state.yaw + k * (v * dt + a * dt**2 / 2))
    speed = v + a * dt
    return State(x, y, yaw, speed * math.cos(yaw), speed * math.sin(yaw))


def bicycle_inverse(
    before: State, after: State, dt: float, moving_speed: float
) -> tuple[float, float]:
    """Estimates the (acceleration, curvature) between two states (equation 3).

    yaw' of `bicycle_between` is the direction of the velocity after the step,
    atan2(vy', vx') where the paper prints arctan(vx'/vy'), turned round in reverse; it
    is the yaw of the pose where the object stands.

    Args:
        before: the state before the step.
        after: the state after the step.
        dt: length of the step [s].
        moving_speed: an object stands up to this speed after the step [m/s].
    """
    yaw_after = after.yaw
    if math.hypot(after.vx, after.vy) > moving_speed:
        yaw_after = math.atan2(after.vy, after.vx)
        if signed_speed(after) < 0:
            yaw_after += math.pi
    return bicycle_between(before, after, yaw_after - before.yaw, dt)


def bicycle_between(
    before: State, after: State, turn: float, dt: float
) -> tuple[float, float]:
    """Returns the (acceleration, curvature) of a step that turns by an angle.

        a = (v' - v) / dt
        k = turn / (v dt + a dt^2 / 2)

    Returns:
        The acceleration [m/s^2] and the curvature [1/m], neither clipped; the curvature
        is 0 where the distance is below 1 mm.
    """
    v, v_after = signed_speed(before), signed_speed(after)
    a = (v_after - v) / dt
    distance = v * dt + a * dt**2 / 2
    if abs(distance) < MIN_DISTANCE:
        return a, 0.0
    return a, geometry.wrap_angle(turn) / distance


def kinematic_bicycle_forward(
    state: State, length: float, acceleration: float, steering: float, dt: float
) -> State:
    """Advances an object by the kinematic bicycle of Nocturne (appendix D).

        u = v + a dt / 2, beta = atan(tan(s) / 2)
        x' = x + u cos(yaw + beta) dt, and y' alike with sin
        yaw' = yaw + u cos(beta) tan(s) / L dt
        v' = v + a dt, along yaw'

    Args:
        state: before the step; v is its signed speed.
        length: L, of the whole vehicle [m].
        acceleration: a [m/s^2].
        steering: s [rad].
        dt: length of the step [s].
    """
    v = signed_speed(state)
    u = v + acceleration * dt / 2
    beta = math.atan(0.5 * math.tan(steering))
    x = state.x + u * math.cos(state.yaw + beta) * dt
    y = state.y + u * math.sin(state.yaw + beta) * dt
    rate = u * math.cos(beta) * math.tan(steering) / length
    yaw = geometry.wrap_angle(state.yaw + rate * dt)
    speed = v + acceleration * dt
    return State(x, y, yaw, speed * math.cos(yaw), speed * math.sin(yaw))


def kinematic_bicycle_inverse(
    before: State, after: State, length: float, dt: float
) -> tuple[float, float]:
    """Returns the (acceleration, steering) between two states (appendix D).

        a = (v' - v) / dt
        s = atan(2 C / sqrt(4 - C^2)), C = 2 L w / (v + v')

    Returns:
        The acceleration [m/s^2] and the steering [rad]: NaN where |C| >= 2 or both
        speeds are 0.
    """
    v, v_after = signed_speed(before), signed_speed(after)
    w = geometry.wrap_angle(after.yaw - before.yaw) / dt
    c = 2 * length * w / (v + v_after) if v + v_after else math.nan
    s = math.atan(2 * c / math.sqrt(4 - c**2)) if abs(c) < 2 else math.nan
    return (v_after - v) / dt, s


def discretize(
    value: Sequence[float],
    low: Sequence[float],
    high: Sequence[float],
    bins: Sequence[int],
) -> int:
    """Numbers an action by the nearest bin of each component, half to even.

    The bins of a component are `bins` equally spaced values (at least 2) from `low` to
    `high`; beyond them the outermost counts. The index is row-major: the first
    component changes slowest.
    """
    index = 0
    for component in range(len(bins)):
        span = high[component] - low[component]
        place = (value[component] - low[component]) / span * (bins[component] - 1)
        nearest = min(max(round(place), 0), bins[component] - 1)
        index = index * bins[component] + nearest
    return index


def undiscretize(
    index: int, low: Sequence[float], high: Sequence[float], bins: Sequence[int]
) -> tuple[float, ...]:
    """Returns the action that stands at an index of `discretize`."""
    places = np.unravel_index(index, tuple(bins))
    return tuple(
        float(np.linspace(low[component], high[component], bins[component])[place])
        for component, place in enumerate(places)
    )
