"""Tests the delta dynamics against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import geometry
from drivetrain.sim.dynamics.delta import delta
from tests import worlds
from tests.oracles import dynamics as oracle

DT = 0.1
FRAMES = ("local", "global")
ROUNDING = 1e-3  # metres; see `worlds.ROUNDING`
SPEED_ROUNDING = 1e-4  # metres per second: of a move of up to 20 m, divided by 0.1 s
TURN_ROUNDING = 2e-6  # radians; float32 below pi, a few operations


def state(motion, i: int) -> oracle.State:
    """Returns one object in float64."""
    return oracle.State(
        *np.float64(motion.xy[i]), float(motion.yaw[i]), *np.float64(motion.velocity[i])
    )


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("frame", FRAMES)
def test_forward_equals_the_oracle(kind: str, frame: str) -> None:
    before, _ = worlds.kicked_pairs(kind)
    scale = (3.0, 0.5, 0.3)
    rng = np.random.default_rng(0)
    action = rng.normal(0, scale, (len(before.yaw), 3)).astype(np.float32)
    after = delta(frame).forward(
        before, worlds.car_size(before), jnp.asarray(action), DT
    )
    expected = np.array(
        [
            oracle.delta_forward(
                state(before, i), *map(float, action[i]), DT, local=frame == "local"
            )
            for i in range(len(before.yaw))
        ]
    )
    np.testing.assert_allclose(after.xy, expected[:, :2], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(
        after.velocity, expected[:, 3:], rtol=0, atol=SPEED_ROUNDING
    )
    turn = geometry.wrap_angle(after.yaw - jnp.float32(expected[:, 2]))
    np.testing.assert_allclose(turn, 0, atol=TURN_ROUNDING)


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("frame", FRAMES)
def test_inverse_equals_the_oracle(kind: str, frame: str) -> None:
    before, after = worlds.kicked_pairs(kind)
    action = delta(frame).inverse(before, after, worlds.car_size(before), DT)
    expected = [
        oracle.delta_inverse(state(before, i), state(after, i), local=frame == "local")
        for i in range(len(before.yaw))
    ]
    np.testing.assert_allclose(action, expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("frame", FRAMES)
def test_forward_of_the_inverse_reaches_the_pose(frame: str) -> None:
    before, after = worlds.kicked_pairs("generated")
    dynamics = delta(frame)
    reached = dynamics.forward(
        before,
        worlds.car_size(before),
        dynamics.inverse(before, after, worlds.car_size(before), DT),
        DT,
    )
    np.testing.assert_allclose(reached.xy, after.xy, rtol=0, atol=ROUNDING)
    turn = geometry.wrap_angle(reached.yaw - after.yaw)
    np.testing.assert_allclose(turn, 0, atol=2 * TURN_ROUNDING)


@pytest.mark.parametrize("frame", FRAMES)
def test_the_velocity_is_that_of_the_move(frame: str) -> None:
    before, _ = worlds.kicked_pairs("generated")
    action = jnp.ones((len(before.yaw), 3))
    after = delta(frame).forward(before, worlds.car_size(before), action, DT)
    np.testing.assert_allclose(after.speed, np.sqrt(2) / DT, rtol=1e-6)


@pytest.mark.parametrize("frame", FRAMES)
def test_gradients_are_finite_and_right_where_nothing_moves(frame: str) -> None:
    before, _ = worlds.kicked_pairs("generated")
    rest = jax.tree.map(lambda leaf: leaf[0], before)
    rest = rest.replace(velocity=jnp.zeros(2))

    def reach(action):
        return jnp.sum(delta(frame).forward(rest, worlds.car_size(rest), action, DT).xy)

    gradient = jax.grad(reach)(jnp.zeros(3))
    yaw = float(rest.yaw) if frame == "local" else 0.0
    cos, sin = np.cos(yaw), np.sin(yaw)
    np.testing.assert_allclose(gradient, (cos + sin, cos - sin, 0), atol=1e-6)
