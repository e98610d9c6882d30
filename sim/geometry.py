"""Does plane geometry of angles, frames and boxes, elementwise over leading axes."""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


def wrap_angle(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Returns the same angle in [-pi, pi)."""
    return (angle + jnp.pi) % (2 * jnp.pi) - jnp.pi


def direction(yaw: Float[Array, "*batch"]) -> Float[Array, "*batch 2"]:
    """Returns the unit vector along a yaw."""
    return jnp.stack([jnp.cos(yaw), jnp.sin(yaw)], axis=-1)


def angle(x: Float[Array, "*x"], y: Float[Array, "*y"]) -> Float[Array, "*c"]:
    """Returns the angle from the x-axis to a vector in [-pi, pi], as `arctan2` does.

    By a polynomial, within 1e-6 rad, because XLA asks for `arctan2` number by number
    on CPUs. Not for the zero vector.
    """
    steep = jnp.abs(y) > jnp.abs(x)
    slope = jnp.where(steep, x, y) / jnp.where(steep, y, x)
    near = slope * jnp.polyval(_ARCTAN, slope**2)
    right_angle = jnp.where(y < 0, -jnp.pi / 2, jnp.pi / 2)
    half_turn = jnp.where(x < 0, 2 * right_angle, 0.0)
    return jnp.where(steep, right_angle - near, half_turn + near)


def _arctan_coefficients() -> np.ndarray:
    """Returns those of arctan(sqrt(s)) / sqrt(s) for s in [0, 1], highest first."""
    series = np.polynomial.Chebyshev.interpolate(
        lambda s: np.arctan(np.sqrt(s)) / np.sqrt(s), deg=9, domain=[0, 1]
    )
    polynomial = series.convert(kind=np.polynomial.Polynomial)
    return polynomial.coef[::-1].astype(np.float32)


_ARCTAN = _arctan_coefficients()


def cross(a: Float[Array, "*a 2"], b: Float[Array, "*b 2"]) -> Float[Array, "*c"]:
    """Returns the third component of the cross product: positive if b is left of a."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def dot(a: Float[Array, "*a n"], b: Float[Array, "*b n"]) -> Float[Array, "*c"]:
    """Returns the inner product over the last axis, which is short.

    Written out, for XLA on CPUs does not fuse sums over an axis with what is around.
    """
    products = a * b
    terms = [products[..., i] for i in range(products.shape[-1])]
    return functools.reduce(jnp.add, terms)


def norm(a: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """Returns the length over the last axis, with gradient zero at the zero vector."""
    squared = dot(a, a)
    is_zero = squared == 0  # NaN is not: what is no number has no length
    return jnp.where(is_zero, 0.0, jnp.sqrt(jnp.where(is_zero, 1.0, squared)))


def to_frame(
    vector: Float[Array, "*batch 2"], yaw: Float[Array, "*yaw"]
) -> Float[Array, "*c 2"]:
    """Turns map-frame vectors into a frame whose x-axis points along `yaw`."""
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    x, y = vector[..., 0], vector[..., 1]
    return jnp.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)


def from_frame(
    vector: Float[Array, "*batch 2"], yaw: Float[Array, "*yaw"]
) -> Float[Array, "*c 2"]:
    """Turns vectors of a frame whose x-axis points along `yaw` into the map frame."""
    return to_frame(vector, -yaw)


def box_corners(
    xy: Float[Array, "*batch 2"],
    yaw: Float[Array, "*batch"],
    size: Float[Array, "*batch 3"],
) -> Float[Array, "*batch 4 2"]:
    """Returns the corners of boxes: front left, rear left, rear right, front right."""
    forward = direction(yaw)
    left = jnp.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    along, across = size[..., 0:1] / 2 * forward, size[..., 1:2] / 2 * left
    corners = [along + across, across - along, -along - across, along - across]
    return xy[..., None, :] + jnp.stack(corners, axis=-2)


def boxes_gap(
    xy_a: Float[Array, "*a 2"],
    yaw_a: Float[Array, "*b"],
    size_a: Float[Array, "*c n"],
    xy_b: Float[Array, "*d 2"],
    yaw_b: Float[Array, "*e"],
    size_b: Float[Array, "*f m"],
) -> Float[Array, "*g"]:
    """Returns how far apart boxes are, by separating axes; negative if they overlap.

    It is the widest gap along the directions of their four sides, which is never more
    than the distance; of boxes that overlap, minus the shortest shift that parts them.
    Heights are not looked at.
    """
    forward_a, forward_b = direction(yaw_a), direction(yaw_b)
    cos = jnp.abs(dot(forward_a, forward_b))
    sin = jnp.abs(cross(forward_a, forward_b))
    length_a, width_a = size_a[..., 0] / 2, size_a[..., 1] / 2
    length_b, width_b = size_b[..., 0] / 2, size_b[..., 1] / 2
    offset = xy_b - xy_a
    gaps = [
        jnp.abs(dot(forward_a, offset)) - (length_a + length_b * cos + width_b * sin),
        jnp.abs(cross(forward_a, offset)) - (width_a + length_b * sin + width_b * cos),
        jnp.abs(dot(forward_b, offset)) - (length_b + length_a * cos + width_a * sin),
        jnp.abs(cross(forward_b, offset)) - (width_b + length_a * sin + width_a * cos),
    ]
    return functools.reduce(jnp.maximum, gaps)


def boxes_overlap(
    xy_a: Float[Array, "*a 2"],
    yaw_a: Float[Array, "*b"],
    size_a: Float[Array, "*c n"],
    xy_b: Float[Array, "*d 2"],
    yaw_b: Float[Array, "*e"],
    size_b: Float[Array, "*f m"],
) -> Bool[Array, "*g"]:
    """Tells whether boxes share area; touching is no overlap.

    Two boxes are apart if and only if they are apart along one of their four sides'
    directions. Heights are not looked at.
    """
    return boxes_gap(xy_a, yaw_a, size_a, xy_b, yaw_b, size_b) < 0


def nearest_on_segment(
    point: Float[Array, "*point n"],
    start: Float[Array, "*segment n"],
    end: Float[Array, "*segment n"],
) -> Float[Array, "*c"]:
    """Returns how far along the segment its nearest point lies, from 0 to 1.

    A segment without length answers 0.
    """
    along = end - start
    squared_length = dot(along, along)
    positive = squared_length > 0
    share = dot(point - start, along) / jnp.where(positive, squared_length, 1.0)
    return jnp.where(positive, jnp.clip(share, 0.0, 1.0), 0.0)
