"""Tests the kinematic bicycle against the oracle and against Nocturne itself."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from drivetrain.sim import geometry
from drivetrain.sim.dynamics import kinematic_bicycle as bicycle
from drivetrain.sim.dynamics.build import build
from drivetrain.sim.motion import Motion
from tests import worlds
from tests.oracles import dynamics as oracle

DT = 0.1
SCENES = ("example", "large")
NOCTURNE = worlds.REAL_DATA.parent / "oracles/nocturne"
STEP_ERROR = 1e-3  # metres; at 9 km Nocturne's float32 steps by 1 mm
ROUNDING = 1e-3  # metres; see `worlds.ROUNDING`
SPEED_ROUNDING = 2e-5  # metres per second; float32 at 60 m/s, a few operations
TURN_ROUNDING = 3e-6  # radians; float32 below pi, a few operations
ACCELERATION_ROUNDING = 5e-4  # a difference of speeds, divided by 0.1 s
GRADIENT = 1e-2  # of finite differences in float32


@functools.cache
def stored(kind: str, scene: str) -> dict[str, np.ndarray]:
    """Returns what Nocturne gave; skips where it is absent."""
    path = NOCTURNE / f"{kind}_{scene}.npz"
    if not path.exists():
        pytest.skip("the outputs of Nocturne of ../shared/oracles are not here")
    with np.load(path) as file:
        return dict(file)


def motion_of(state: np.ndarray, origin: np.ndarray) -> Motion:
    """Returns states of x, y, heading and speed about an origin."""
    state = np.float64(state)
    heading = np.stack([np.cos(state[..., 2]), np.sin(state[..., 2])], axis=-1)
    xyz = np.pad(state[..., :2] - origin, [*[(0, 0)] * (state.ndim - 1), (0, 1)])
    return Motion(
        xyz=jnp.asarray(xyz, jnp.float32),
        yaw=jnp.asarray(state[..., 2], jnp.float32),
        velocity=jnp.asarray(state[..., 3:] * heading, jnp.float32),
        valid=jnp.ones(state.shape[:-1], bool),
    )


def sizes(length_width: np.ndarray, count: int) -> jax.Array:
    """Returns the sizes of vehicles at each of some steps."""
    size = np.pad(length_width, [(0, 0), (0, 1)], constant_values=1.5)
    return jnp.asarray(np.tile(size, (count, 1, 1)))


def state_of(motion: Motion, i: int) -> oracle.State:
    """Returns one object in float64."""
    return oracle.State(
        *np.float64(motion.xy[i]), float(motion.yaw[i]), *np.float64(motion.velocity[i])
    )


@pytest.mark.parametrize("scene", SCENES)
def test_each_step_is_that_of_nocturne(scene: str) -> None:
    data = stored("dynamics", scene)
    state, action = data["state"], jnp.asarray(data["actions"])
    origin = np.float64(state[0, :, :2]).mean(axis=0)
    before, after = motion_of(state[:-1], origin), motion_of(state[1:], origin)
    size = sizes(data["length_width"], len(action))
    moved = bicycle.forward(before, size, action, DT)
    assert float(geometry.norm(moved.xy - after.xy).max()) < STEP_ERROR
    turn = geometry.wrap_angle(moved.yaw - after.yaw)
    np.testing.assert_allclose(turn, 0, atol=TURN_ROUNDING)
    np.testing.assert_allclose(
        moved.velocity, after.velocity, rtol=0, atol=2 * SPEED_ROUNDING
    )


@pytest.mark.parametrize("scene", SCENES)
def test_the_inverse_is_the_expert_of_nocturne(scene: str) -> None:
    expert = stored("expert_action", scene)
    expected, log = expert["expert_action"], stored("obs", scene)["expert_state"]
    seen = ~np.isnan(expected[..., 0])
    before, after = (
        motion_of(np.where(seen[..., None], state, 0.0), np.zeros(2))
        for state in (log[:-1], log[1:])
    )
    size = sizes(expert["length_width"], len(expected))
    action = np.asarray(bicycle.inverse(before, after, size, DT), np.float64)
    assert np.isfinite(action).all()
    np.testing.assert_allclose(
        action[seen, 0], expected[seen, 0], rtol=0, atol=ACCELERATION_ROUNDING
    )
    speeds = np.float64(log[:-1, :, 3] + log[1:, :, 3])
    moving = ~np.isnan(expected[..., 1]) & (speeds > 2 * bicycle.STANDING_SPEED)
    assert moving.sum() > 100  # else the scene proves nothing
    # Rounding of a turn is one of C by 2 L / (v + v') dt; the steering itself answers
    # to C without bound as C nears 2.
    c, c_expected = (
        2 * np.sin(np.arctan(np.tan(steering[moving, 1]) / 2))
        for steering in (action, expected)
    )
    lengths = np.asarray(size)[moving, 0]
    rounding = TURN_ROUNDING * (1 + 2 * lengths / speeds[moving] / DT)
    reachable = np.clip(c_expected, -bicycle.MAX_TURN, bicycle.MAX_TURN)
    assert (np.abs(c - reachable) < rounding).all()


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_forward_equals_the_oracle(kind: str) -> None:
    before, _ = worlds.kicked_pairs(kind)
    rng = np.random.default_rng(0)
    action = rng.uniform((-9, -1.4), (9, 1.4), (len(before.yaw), 2)).astype(np.float32)
    size = worlds.car_size(before)
    after = bicycle.forward(before, size, jnp.asarray(action), DT)
    expected = np.array(
        [
            oracle.kinematic_bicycle_forward(
                state_of(before, i), float(size[i, 0]), *map(float, action[i]), DT
            )
            for i in range(len(action))
        ]
    )
    np.testing.assert_allclose(after.xy, expected[:, :2], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(
        after.velocity, expected[:, 3:], rtol=0, atol=10 * SPEED_ROUNDING
    )
    turn = geometry.wrap_angle(after.yaw - jnp.float32(expected[:, 2]))
    np.testing.assert_allclose(turn, 0, atol=2 * TURN_ROUNDING)


def test_inverse_undoes_forward_also_in_reverse() -> None:
    before, _ = worlds.kicked_pairs("generated")
    before = jax.tree.map(lambda leaf: leaf[np.asarray(before.speed) > 2], before)
    assert bool(
        (geometry.dot(before.velocity, geometry.direction(before.yaw)) < 0).any()
    )
    rng = np.random.default_rng(1)
    action = rng.uniform(bicycle.LOW, bicycle.HIGH, (len(before.yaw), 2))
    action = jnp.asarray(action, jnp.float32)
    size = worlds.car_size(before)
    undone = bicycle.inverse(
        before, bicycle.forward(before, size, action, DT), size, DT
    )
    np.testing.assert_allclose(
        undone[:, 0], action[:, 0], rtol=0, atol=ACCELERATION_ROUNDING
    )
    # At 1.7 m/s or more a turn by 0.17 m makes the length of the car.
    np.testing.assert_allclose(
        undone[:, 1], action[:, 1], rtol=0, atol=4.5 / 0.17 * TURN_ROUNDING
    )


def test_what_turns_tighter_than_any_steering_is_steered_to_the_end() -> None:
    # C = 2 L w / (v + v') = 2 * 4.5 * 10 / 2 on the spot, to both sides.
    before = motion_of(np.array([[0, 0, 0, 1.0], [0, 0, 0, 1.0]]), np.zeros(2))
    after = motion_of(np.array([[0, 0, 1.0, 1.0], [0, 0, -1.0, 1.0]]), np.zeros(2))
    steering = bicycle.inverse(before, after, worlds.car_size(before), DT)[:, 1]
    assert float(steering[0]) == -float(steering[1])
    assert 1.5 < float(steering[0]) < np.pi / 2


def test_what_stands_is_not_steered() -> None:
    before = motion_of(np.array([[3.0, 4, 0, 0]]), np.zeros(2))
    after = motion_of(np.array([[3.0, 4, 1, 0]]), np.zeros(2))
    action = bicycle.inverse(before, after, worlds.car_size(before), DT)
    np.testing.assert_array_equal(action, 0)


def test_tilting_the_head_is_a_control_that_moves_nothing() -> None:
    before, _ = worlds.kicked_pairs("generated")
    size = worlds.car_size(before)
    dynamics = build("kinematic_bicycle_head")
    # 6 x 21 x 5 bins: each index of five neighbours is another tilt.
    ahead, aside = (jnp.full(len(before.yaw), 5 * 70 + tilt) for tilt in (2, 4))
    moved, moved_aside = (dynamics.forward(before, size, a, DT) for a in (ahead, aside))
    for one, other in zip(
        jax.tree.leaves(moved), jax.tree.leaves(moved_aside), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(dynamics.controls(ahead)[:, 2], 0, atol=1e-6)
    np.testing.assert_allclose(dynamics.controls(aside)[:, 2], 1.6, rtol=1e-6)
    back = dynamics.inverse(before, moved_aside, size, DT)
    np.testing.assert_allclose(dynamics.controls(back)[:, 2], 0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "num_actions"),
    [("kinematic_bicycle_discrete", 15 * 43), ("kinematic_bicycle_head", 6 * 21 * 5)],
)
def test_coasting_is_on_the_grid(name: str, num_actions: int) -> None:
    dynamics = build(name)
    assert dynamics.action_spec.num_actions == num_actions
    before, _ = worlds.kicked_pairs("generated")
    controls = dynamics.controls(dynamics.coast(before, DT))
    np.testing.assert_allclose(controls, 0, atol=1e-6)


def test_gradients_are_those_of_finite_differences() -> None:
    before, _ = worlds.kicked_pairs("generated")
    one = jax.tree.map(lambda leaf: leaf[np.argmax(before.speed > 2)], before)
    one = one.replace(xyz=jnp.zeros(3))

    def moved(action):
        after = bicycle.forward(one, worlds.car_size(one), jnp.asarray(action), DT)
        return jnp.concatenate([after.xy, after.velocity, after.yaw[None]])

    check_grads(moved, (jnp.array([1.0, 0.3]),), 1, atol=GRADIENT, rtol=GRADIENT)


@pytest.mark.parametrize("steering", [0.0, np.pi / 2, -np.pi / 2, 1e6])
def test_no_steering_makes_anything_infinite(steering: float) -> None:
    rest = motion_of(np.zeros((2, 4)), np.zeros(2))
    size = worlds.car_size(rest).at[1].set(0.0)  # an empty slot has no length

    def drive(velocity, action):
        there = bicycle.forward(rest.replace(velocity=velocity), size, action, DT)
        back = bicycle.inverse(rest.replace(velocity=velocity), there, size, DT)
        return sum(map(jnp.sum, (there.xy, there.velocity, there.yaw, back)))

    action = jnp.full((2, 2), steering)
    values, gradients = jax.value_and_grad(drive, argnums=(0, 1))(
        jnp.zeros((2, 2)), action
    )
    assert np.isfinite(values)
    assert all(np.isfinite(gradient).all() for gradient in gradients)
