"""Tests the bicycle against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from drivetrain.sim import geometry
from drivetrain.sim.dynamics import bicycle
from drivetrain.sim.motion import Motion
from tests import worlds
from tests.oracles import dynamics as oracle

DT = 0.1
ROUNDING = 1e-3  # metres; see `worlds.ROUNDING`
SPEED_ROUNDING = 2e-5  # metres per second; float32 at 60 m/s, a few operations
TURN_ROUNDING = 3e-6  # radians; float32 below pi, a few operations
ACCELERATION_ROUNDING = 5e-4  # a difference of speeds, divided by 0.1 s

# Each step of length d keeps to the tangent and ends d^2 / 2 R beside the circle: 18 mm
# at 6 m/s, 4.5 mm at 3 m/s, and 0.31 m in all if nothing cancels.
CIRCLE_ERROR = 0.31  # metres

GRADIENT = 1e-2  # of finite differences in float32


def state(motion: Motion, i: int) -> oracle.State:
    """Returns one object in float64."""
    return oracle.State(
        *np.float64(motion.xy[i]), float(motion.yaw[i]), *np.float64(motion.velocity[i])
    )


def is_near_across(state: oracle.State) -> bool:
    """Tells whether rounding decides if the velocity points backwards."""
    along = state.vx * np.cos(state.yaw) + state.vy * np.sin(state.yaw)
    return abs(along) < SPEED_ROUNDING


def actions(count: int, scale: float) -> jax.Array:
    """Returns actions; beyond the limits where the scale is above 1."""
    rng = np.random.default_rng(0)
    limits = scale * np.array([bicycle.MAX_ACCELERATION, bicycle.MAX_CURVATURE])
    return jnp.asarray(rng.uniform(-limits, limits, (count, 2)), jnp.float32)


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_forward_equals_the_oracle(kind: str) -> None:
    before, _ = worlds.kicked_pairs(kind)
    action = actions(len(before.yaw), 1.5)
    after = bicycle.forward(before, worlds.car_size(before), action, DT)
    expected = np.array(
        [
            oracle.bicycle_forward(state(before, i), *map(float, action[i]), DT)
            for i in range(len(before.yaw))
        ]
    )
    np.testing.assert_allclose(after.xy, expected[:, :2], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(
        after.velocity, expected[:, 3:], rtol=0, atol=10 * SPEED_ROUNDING
    )
    turn = geometry.wrap_angle(after.yaw - jnp.float32(expected[:, 2]))
    np.testing.assert_allclose(turn, 0, atol=TURN_ROUNDING)


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_inverse_equals_the_oracle(kind: str) -> None:
    before, after = worlds.kicked_pairs(kind)
    action = np.asarray(bicycle.inverse(before, after, worlds.car_size(before), DT))
    for i in range(len(before.yaw)):
        start, end = state(before, i), state(after, i)
        speed, speed_after = map(oracle.signed_speed, (start, end))
        distance = (speed + speed_after) / 2 * DT
        is_across = any(is_near_across(s) for s in (start, end))
        expected = oracle.bicycle_inverse(start, end, DT, bicycle.MOVING_SPEED)
        off = abs(action[i, 0] - expected[0])
        assert is_across or off < ACCELERATION_ROUNDING
        is_tie = (
            is_across
            or abs(abs(speed_after) - bicycle.MOVING_SPEED) < SPEED_ROUNDING
            or abs(abs(distance) - bicycle.STANDING_DISTANCE) < SPEED_ROUNDING
        )
        # A turn and a distance, each rounded; the turn flips near half a circle.
        turn, expected_turn = action[i, 1] * distance, expected[1] * distance
        off = (turn - expected_turn + np.pi) % (2 * np.pi) - np.pi
        relative = SPEED_ROUNDING / max(abs(distance), bicycle.STANDING_DISTANCE)
        assert is_tie or abs(off) < TURN_ROUNDING + abs(turn) * relative


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_inverse_undoes_forward_for_what_moves(kind: str) -> None:
    before, _ = worlds.kicked_pairs(kind)
    before = jax.tree.map(lambda leaf: leaf[np.asarray(before.speed) > 2], before)
    action = actions(len(before.yaw), 1.0)
    undone = bicycle.inverse(
        before,
        bicycle.forward(before, worlds.car_size(before), action, DT),
        worlds.car_size(before),
        DT,
    )
    np.testing.assert_allclose(
        undone[:, 0], action[:, 0], rtol=0, atol=ACCELERATION_ROUNDING
    )
    distance = (before.speed + action[:, 0] * DT / 2) * DT
    turned = (undone[:, 1] - action[:, 1]) * distance
    np.testing.assert_allclose(turned, 0, atol=2 * TURN_ROUNDING)


def test_full_braking_from_rest_is_no_half_turn() -> None:
    rest = Motion(
        xyz=jnp.zeros(3),
        yaw=jnp.float32(0.4),
        velocity=jnp.zeros(2),
        valid=jnp.bool_(True),
    )
    braking = jnp.array([-bicycle.MAX_ACCELERATION, 0.0])
    _, curvature = bicycle.inverse(
        rest,
        bicycle.forward(rest, worlds.car_size(rest), braking, DT),
        worlds.car_size(rest),
        DT,
    )
    assert abs(curvature) * 0.03 < TURN_ROUNDING  # it rolls back by 3 cm


def test_braking_past_zero_rolls_back() -> None:
    motion = Motion(
        xyz=jnp.zeros(3),
        yaw=jnp.float32(0.4),
        velocity=0.3 * geometry.direction(jnp.float32(0.4)),
        valid=jnp.bool_(True),
    )
    size, braking = worlds.car_size(motion), jnp.array([-6.0, 0.0])
    for speed in (-0.3, -0.9, -1.5):
        motion = bicycle.forward(motion, size, braking, DT)
        expected = speed * geometry.direction(motion.yaw)
        np.testing.assert_allclose(motion.velocity, expected, atol=SPEED_ROUNDING)


def test_the_inverse_drives_a_circle_in_reverse() -> None:
    # Backwards at 3 m/s about (0, 10) m; after braking from 6 m/s.
    step = np.arange(60)
    speed = -np.maximum(6.0 - 0.5 * step, 3.0)
    arc = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * DT)])
    yaw = arc / 10.0
    place = 10.0 * np.stack([np.sin(yaw), 1 - np.cos(yaw), 0 * yaw], axis=-1)
    heading = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    log = Motion(
        xyz=jnp.asarray(place, jnp.float32),
        yaw=geometry.wrap_angle(jnp.asarray(yaw, jnp.float32)),
        velocity=jnp.asarray(speed[:, None] * heading, jnp.float32),
        valid=jnp.ones(60, bool),
    )
    at = [jax.tree.map(lambda leaf, i=i: leaf[i], log) for i in range(60)]
    motion, size = at[0], worlds.car_size(at[0])
    for logged in at[1:]:
        action = bicycle.inverse(motion, logged, size, DT)
        motion = bicycle.forward(motion, size, action, DT)
    assert float(geometry.norm(motion.xy - at[-1].xy)) < CIRCLE_ERROR


def test_what_goes_beyond_the_limits_is_clipped() -> None:
    before, _ = worlds.kicked_pairs("generated")
    limits = jnp.array([bicycle.MAX_ACCELERATION, bicycle.MAX_CURVATURE])
    at, beyond = (
        bicycle.forward(
            before,
            worlds.car_size(before),
            jnp.tile(x * limits, (len(before.yaw), 1)),
            DT,
        )
        for x in (1.0, 5.0)
    )
    np.testing.assert_array_equal(at.xyz, beyond.xyz)
    np.testing.assert_array_equal(at.velocity, beyond.velocity)


def test_gradients_are_those_of_finite_differences() -> None:
    before, _ = worlds.kicked_pairs("generated")
    one = jax.tree.map(lambda leaf: leaf[np.argmax(before.speed > 2)], before)

    def moved(action):
        after = bicycle.forward(
            one.replace(xyz=jnp.zeros(3)), worlds.car_size(one), jnp.asarray(action), DT
        )
        return jnp.concatenate([after.xy, after.velocity, after.yaw[None]])

    check_grads(moved, (jnp.array([1.0, 0.1]),), 1, atol=GRADIENT, rtol=GRADIENT)


def test_gradients_are_finite_at_rest() -> None:
    rest = Motion(
        xyz=jnp.zeros((1, 3)),
        yaw=jnp.zeros(1),
        velocity=jnp.zeros((1, 2)),
        valid=jnp.ones(1, bool),
    )

    def drive(velocity, action):
        after = bicycle.forward(
            rest.replace(velocity=velocity), worlds.car_size(rest), action, DT
        )
        back = bicycle.inverse(
            rest.replace(velocity=velocity), after, worlds.car_size(rest), DT
        )
        return jnp.sum(after.xy) + jnp.sum(after.velocity) + jnp.sum(back)

    gradients = jax.grad(drive, argnums=(0, 1))(jnp.zeros((1, 2)), jnp.zeros((1, 2)))
    assert all(np.isfinite(g).all() for g in gradients)
