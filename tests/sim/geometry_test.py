"""Tests plane geometry against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim import geometry
from tests.oracles import geometry as oracle

COUNT = 400
ROUNDING = 2e-6  # float32, a few operations on numbers up to 10
NEAR_TOUCH = 1e-4  # metres by which a box is made larger and smaller
HALF_TURN = np.float32(np.pi)


def boxes(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns places, yaws and sizes, near enough to overlap about half of the time."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-3, 3, (COUNT, 2)).astype(np.float32)
    yaw = rng.uniform(-np.pi, np.pi, COUNT).astype(np.float32)
    size = rng.uniform(0.3, 6, (COUNT, 3)).astype(np.float32)
    return xy, yaw, size


def box(xy: np.ndarray, yaw: float, size: np.ndarray, more: float = 0.0) -> oracle.Box:
    """Returns a box of the oracle, larger by some metres."""
    length, width = np.float64(size[:2]) + more
    return oracle.Box(np.float64(xy), float(yaw), length, width)


def test_wrapping_keeps_the_direction() -> None:
    angle = np.random.default_rng(0).uniform(-20, 20, COUNT).astype(np.float32)
    wrapped = np.asarray(geometry.wrap_angle(jnp.asarray(angle)), np.float64)
    expected = [oracle.wrap_angle(float(a)) for a in angle]
    turns = (wrapped - expected + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(turns, 0, atol=5 * ROUNDING)
    assert (np.abs(wrapped) <= HALF_TURN).all()


def test_angles_are_those_of_arctan2_and_so_are_their_gradients() -> None:
    rng = np.random.default_rng(0)
    length = np.exp(rng.normal(0, 8, COUNT))
    eighths = np.pi / 4 * np.arange(-3, 5)
    yaw = np.append(rng.uniform(-np.pi, np.pi, COUNT - 8), eighths)
    x, y = jnp.array([length * np.cos(yaw), length * np.sin(yaw)], jnp.float32)
    expected = np.arctan2(np.float64(y), np.float64(x))
    np.testing.assert_allclose(geometry.angle(x, y), expected, rtol=0, atol=1e-6)
    for number, along in enumerate((-np.sin(yaw), np.cos(yaw))):
        slope = jax.vmap(jax.grad(geometry.angle, argnums=number))(x, y)
        # The polynomial's slope is less exact than its value.
        np.testing.assert_allclose(slope * length, along, rtol=0, atol=1e-5)


def test_half_a_turn_is_negative() -> None:
    ends = geometry.wrap_angle(jnp.array([HALF_TURN, -HALF_TURN]))
    np.testing.assert_array_equal(ends, [-HALF_TURN, -HALF_TURN])


def test_corners_are_those_of_the_oracle() -> None:
    xy, yaw, size = boxes(1)
    corners = geometry.box_corners(*map(jnp.asarray, (xy, yaw, size)))
    expected = [oracle.corners(box(xy[i], yaw[i], size[i])) for i in range(COUNT)]
    np.testing.assert_allclose(corners, expected, atol=ROUNDING)


def test_boxes_overlap_as_in_the_oracle() -> None:
    a, b = boxes(2), boxes(3)
    overlap = np.asarray(geometry.boxes_overlap(*map(jnp.asarray, (*a, *b))))
    for i in range(COUNT):
        verdicts = [
            oracle.boxes_overlap(
                box(*(part[i] for part in a), more), box(*(part[i] for part in b), more)
            )
            for more in (-NEAR_TOUCH, NEAR_TOUCH)
        ]
        assert overlap[i] in verdicts
    assert 0.2 < overlap.mean() < 0.8


def test_overlap_is_mutual() -> None:
    a, b = (tuple(map(jnp.asarray, boxes(seed))) for seed in (4, 5))
    np.testing.assert_array_equal(
        geometry.boxes_overlap(*a, *b), geometry.boxes_overlap(*b, *a)
    )


def test_boxes_that_touch_do_not_overlap() -> None:
    size = jnp.array([4.0, 2.0, 1.5])
    verdicts = [
        geometry.boxes_overlap(
            jnp.zeros(2), jnp.float32(0), size, jnp.array(xy), jnp.float32(0), size
        )
        for xy in ((4.0, 0.0), (0.0, 2.0), (4.0, 2.0), (3.99, 1.99))
    ]
    assert list(map(bool, verdicts)) == [False, False, False, True]


def test_frames_undo_each_other() -> None:
    xy, yaw, _ = map(jnp.asarray, boxes(6))
    there = geometry.to_frame(xy, yaw)
    np.testing.assert_allclose(geometry.from_frame(there, yaw), xy, atol=ROUNDING)


def test_a_yaw_is_the_x_axis_of_its_frame() -> None:
    _, yaw, _ = map(jnp.asarray, boxes(7))
    ahead = geometry.to_frame(geometry.direction(yaw), yaw)
    np.testing.assert_allclose(ahead, np.tile([1.0, 0.0], (COUNT, 1)), atol=ROUNDING)


def test_the_nearest_place_of_a_segment_is_that_of_the_oracle() -> None:
    rng = np.random.default_rng(8)
    point, start, end = rng.uniform(-5, 5, (3, COUNT, 3)).astype(np.float32)
    end[::7] = start[::7]
    share = geometry.nearest_on_segment(*map(jnp.asarray, (point, start, end)))
    expected = [
        oracle.feet(np.float64(p), np.float64(a)[None], np.float64(b)[None])[0][0]
        for p, a, b in zip(point, start, end, strict=True)
    ]
    np.testing.assert_allclose(share, expected, atol=20 * ROUNDING)  # short segments


def test_the_length_of_nothing_has_the_gradient_zero() -> None:
    gradient = jax.grad(geometry.norm)(jnp.zeros(2))
    np.testing.assert_array_equal(gradient, np.zeros(2))
    at_coincident = jax.grad(
        lambda p: geometry.nearest_on_segment(p, jnp.ones(2), jnp.ones(2))
    )(jnp.ones(2))
    np.testing.assert_array_equal(at_coincident, np.zeros(2))
