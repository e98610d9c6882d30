"""Finds what a viewer sees: boxes and points in its cone that no box hides (N 3.4).

The answers are flags and numbers, without a gradient.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .. import geometry
from ..box_search import Boxes
from ..native import library
from ..records import Record
from .nearest import nearest

# Beside what it borders a ray passes at this angle [rad]: ten times the rounding of an
# angle in float32, and 0.8 mm at 80 m. What shows through a narrower gap is not seen.
BESIDE = 1e-5


class Cone(Record):
    """What could be seen if nothing were in the way: a sector of a disc."""

    xy: Float[Array, " 2"]  # the viewer [m]
    yaw: Float[Array, ""]  # of the axis, radians
    angle: float  # between the sides, radians up to 2 pi
    distance: float | Float[Array, ""]  # metres

    def operand(self) -> Float[Array, " 5"]:
        """Returns the cone as kernels want it."""
        rest = [jnp.asarray(x) for x in (self.yaw, self.angle, self.distance)]
        return jnp.concatenate([self.xy, jnp.stack(rest)])

    def contains(self, points: Float[Array, "points 2"]) -> Bool[Array, " points"]:
        """Tells which points lie in the cone, sides included."""
        distance, ahead, _ = self._place(points)
        return self._is_between_sides(distance, ahead) & (distance <= self.distance)

    def touches(
        self, points: Float[Array, "points 2"], radius: float
    ) -> Bool[Array, " points"]:
        """Tells which discs of a radius [m] about points meet the cone."""
        distance, ahead, aside = self._place(points)
        cos, sin = jnp.cos(self.angle / 2), jnp.sin(self.angle / 2)
        along_side = jnp.clip(cos * ahead + sin * aside, 0.0, self.distance)
        to_side = (ahead - along_side * cos) ** 2 + (aside - along_side * sin) ** 2
        return jnp.where(
            self._is_between_sides(distance, ahead),
            distance <= self.distance + radius,
            to_side <= radius**2,
        )

    def _place(self, points):
        """Returns distances from the viewer, along the axis, and to either side."""
        x, y = points[:, 0] - self.xy[0], points[:, 1] - self.xy[1]
        cos, sin = geometry.direction(self.yaw)
        return jnp.sqrt(x**2 + y**2), cos * x + sin * y, jnp.abs(cos * y - sin * x)

    def _is_between_sides(self, distance, ahead):
        # The slack keeps what lies exactly behind in a cone of a whole turn.
        return ahead >= (jnp.cos(self.angle / 2) - 1e-6) * distance


def visible_objects(
    boxes: Boxes, number: Int[Array, ""], cone: Cone
) -> Bool[Array, " objects"]:
    """Tells which other boxes the ray from the viewer meets first in some direction.

    What is met first changes only where the part of a box that is in reach begins or
    ends, and where boxes overlap, so rays just beside those directions, towards the
    nearest corner of each box and along the sides of the cone find all that is visible.
    N looks along more rays, 1e-4 rad apart, and misses what shows through narrower
    gaps. A viewer inside of a box sees it from within.

    Args:
        boxes: of all objects.
        number: of the viewer, whose own box hides nothing.
        cone: in which it looks.

    Returns:
        True for what is visible; the viewer is not.
    """
    find = library.on_cpu(visible_natively, visible_plainly)
    return find(boxes, number, cone)


def visible_natively(
    boxes: Boxes, number: Int[Array, ""], cone: Cone
) -> Bool[Array, " objects"]:
    """Asks the C++ kernel, on CPUs only."""
    call = jax.ffi.ffi_call(
        "drivetrain_visible_objects",
        jax.ShapeDtypeStruct(boxes.valid.shape, jnp.bool_),
        vmap_method="expand_dims",
    )
    operands = cone.operand(), *boxes.operands()
    return call(number, *operands, beside=np.float32(BESIDE))


def visible_plainly(
    boxes: Boxes, number: Int[Array, ""], cone: Cone
) -> Bool[Array, " objects"]:
    """Asks in plain JAX, on any device."""
    others = boxes.valid & (jnp.arange(len(boxes.valid)) != number)
    begin, end, corner, in_reach = _outlines(boxes, cone)
    half = cone.angle / 2
    rays = [begin - BESIDE, begin + BESIDE, corner, end - BESIDE, end + BESIDE]
    rays = [jnp.where(others & in_reach, angle, half) for angle in rays]
    rays = jnp.concatenate([*rays, jnp.array([-half, half])])
    distance, first = _first_hits(boxes, others, cone.xy, cone.yaw + rays)
    seen = (jnp.abs(rays) <= half) & (distance <= cone.distance)
    first = jnp.where(seen, first, -1)
    return jnp.any(first[None] == jnp.arange(len(others))[:, None], axis=1)


def nearest_visible_points(
    points: Float[Array, "points 2"],
    present: Bool[Array, " points"],
    boxes: Boxes,
    cone: Cone,
    count: int,
) -> tuple[Int[Array, " chosen"], Bool[Array, " chosen"]]:
    """Finds the nearest points to which a straight line from the viewer meets no box.

    Args:
        points: any number of them [m].
        present: which points are there.
        boxes: what hides points: the visible ones, for others stand behind. The work
            grows with the number of the last valid one.
        cone: in which the viewer looks.
        count: how many to choose.

    Returns:
        The numbers of the points, nearest first, and their mask.
    """
    points, boxes, cone = jax.lax.stop_gradient((points, boxes, cone))
    x, y = points[:, 0] - cone.xy[0], points[:, 1] - cone.xy[1]

    def look_past(number, seen):
        hidden = _meets(_in_box_frame(boxes, number, cone.xy, x, y))
        return seen & ~(hidden & boxes.valid[number])

    slots = jnp.arange(len(boxes.valid))
    last = jnp.max(jnp.where(boxes.valid, slots + 1, 0))
    seen = present & cone.contains(points)
    seen = jax.lax.fori_loop(0, last, look_past, seen)
    return nearest(x**2 + y**2, seen, count)


def _outlines(boxes: Boxes, cone: Cone):
    """Finds directions in which boxes appear, as angles to the axis of a cone.

    Returns:
        Where the part of each box that is in reach begins and ends, which is at a
        corner or where a side leaves the circle of the reach; the nearest corner; and
        which boxes are in reach. The others' angles mean nothing.
    """
    offset = boxes.xy - cone.xy[None]
    corners = geometry.box_corners(offset, boxes.yaw, boxes.size)
    along = jnp.roll(corners, -1, axis=1) - corners
    # Solves |corner + share along| = reach.
    squared = geometry.dot(along, along)
    squared = jnp.where(squared > 0, squared, 1.0)
    from_corner = geometry.dot(corners, corners)
    middle = -geometry.dot(corners, along) / squared
    root = middle**2 - (from_corner - cone.distance**2) / squared
    half = jnp.sqrt(jnp.maximum(root, 0.0))
    in_reach = (root >= 0) & (middle - half <= 1) & (middle + half >= 0)
    share = jnp.clip(jnp.stack([middle - half, middle + half], axis=-1), 0.0, 1.0)
    ends = corners[:, :, None] + share[..., None] * along[:, :, None]

    turn = _angle(offset[:, None, None], ends)
    begin = jnp.min(jnp.where(in_reach[..., None], turn, jnp.pi), axis=(1, 2))
    end = jnp.max(jnp.where(in_reach[..., None], turn, -jnp.pi), axis=(1, 2))
    nearest_corner = jnp.argmin(from_corner, axis=1)[:, None, None]
    corner = jnp.take_along_axis(corners, nearest_corner, axis=1)[:, 0]
    angles = jnp.stack([begin, end, _angle(offset, corner)])
    centre = _angle(geometry.direction(cone.yaw)[None], offset)
    begin, end, corner = geometry.wrap_angle(centre[None] + angles)
    return begin, end, corner, jnp.any(in_reach, axis=1)


def _angle(a, b):
    """Returns the angle from one vector to another."""
    return jnp.arctan2(geometry.cross(a, b), geometry.dot(a, b))


def _first_hits(boxes: Boxes, valid, xy, yaw):
    """Finds how far rays reach to the first side of a box, and the box's number."""
    cos, sin = jnp.moveaxis(geometry.direction(yaw), -1, 0)

    def hit(number, first):
        near, far = _crossing(_in_box_frame(boxes, number, xy, cos, sin))
        distance = jnp.where(near > 0, near, far)
        hits = valid[number] & (near <= far) & (far >= 0) & (distance < first[0])
        return jnp.where(hits, distance, first[0]), jnp.where(hits, number, first[1])

    nothing = jnp.full_like(yaw, jnp.inf), jnp.zeros_like(yaw, jnp.int32)
    return jax.lax.fori_loop(0, len(valid), hit, nothing)


def _in_box_frame(boxes: Boxes, number, xy, x, y):
    """Returns along and across a box: its half size, its place and vectors (x, y)."""
    cos, sin = geometry.direction(boxes.yaw[number])
    centre = geometry.to_frame(boxes.xy[number] - xy, boxes.yaw[number])
    vectors = cos * x + sin * y, cos * y - sin * x
    return tuple(zip(boxes.size[number, :2] / 2, centre, vectors, strict=True))


def _crossing(axes):
    """Returns where rays enter and leave a box [m]; those that miss leave before."""
    spans = []
    for half, centre, slope in axes:
        slope = jnp.where(jnp.abs(slope) < 1e-9, 1e-9, slope)
        middle, reach = centre / slope, half / jnp.abs(slope)
        spans.append((middle - reach, middle + reach))
    (near_a, far_a), (near_b, far_b) = spans
    return jnp.maximum(near_a, near_b), jnp.minimum(far_a, far_b)


def _meets(axes):
    """Tells which lines from a viewer touch a box, by separating axes."""
    (length, x, along), (width, y, across) = axes
    return (
        (jnp.abs(2 * x - along) <= 2 * length + jnp.abs(along))
        & (jnp.abs(2 * y - across) <= 2 * width + jnp.abs(across))
        & (
            jnp.abs(along * y - across * x)
            <= length * jnp.abs(across) + width * jnp.abs(along)
        )
    )
