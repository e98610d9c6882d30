"""Tests of what a viewer sees, against rays in plain NumPy and by hand."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.box_search import Boxes
from drivetrain.sim.observations.visibility import (
    Cone,
    nearest_visible_points,
    visible_objects,
)
from tests import worlds
from tests.oracles import visibility as oracle
from tests.oracles.geometry import Box

SEEDS = range(12)
NUM_BOXES, NUM_POINTS = 9, 80
VIEWER = 0
REACH = 30.0
ANGLES = (1.0, 2.1, math.pi, 5.0)


class World:
    """A crowded place: some boxes overlap, some reach out of the view."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        xy = np.float32(rng.uniform(-1.2 * REACH, 1.2 * REACH, (NUM_BOXES, 2)))
        xy[1:3] = xy[3] + np.float32(rng.normal(0, 2, (2, 2)))
        self.xy = xy
        self.yaw = np.float32(rng.uniform(-np.pi, np.pi, NUM_BOXES))
        self.size = np.float32(rng.uniform((3, 1, 1), (14, 3, 3), (NUM_BOXES, 3)))
        self.valid = rng.random(NUM_BOXES) < 0.9
        self.points = np.float32(rng.uniform(-REACH, REACH, (NUM_POINTS, 2)))
        self.present = rng.random(NUM_POINTS) < 0.9
        self.tilt = float(rng.uniform(-np.pi, np.pi))
        self.angle = ANGLES[seed % len(ANGLES)]

    def boxes(self) -> Boxes:
        """Returns all boxes, for the code."""
        return Boxes(*map(jnp.asarray, (self.xy, self.yaw, self.size, self.valid)))

    def view(self) -> oracle.View:
        """Returns where the viewer looks, for the oracle."""
        yaw = float(self.yaw[VIEWER]) + self.tilt
        return oracle.View(np.float64(self.xy[VIEWER]), yaw, self.angle, REACH)

    def others(self) -> dict[int, Box]:
        """Returns the boxes of the others by number, for the oracle."""
        return {
            i: Box(np.float64(self.xy[i]), float(self.yaw[i]), *map(float, size))
            for i, size in enumerate(self.size[:, :2])
            if self.valid[i] and i != VIEWER
        }

    def moved(self, angle: float, shift: np.ndarray) -> "World":
        """Returns the world turned about zero, and then shifted."""
        other = World.__new__(World)
        other.__dict__.update(self.__dict__)
        other.xy = np.float32(worlds.rotate(self.xy, angle) + shift)
        other.points = np.float32(worlds.rotate(self.points, angle) + shift)
        other.yaw = np.float32(self.yaw + angle)
        return other


@functools.partial(jax.jit, static_argnums=3)
def look(boxes: Boxes, number, tilt, angle, points, present):
    cone = Cone(
        xy=boxes.xy[number], yaw=boxes.yaw[number] + tilt, angle=angle, distance=REACH
    )
    visible = visible_objects(boxes, number, cone)
    hiding = boxes.replace(valid=visible)
    return visible, nearest_visible_points(points, present, hiding, cone, NUM_POINTS)


def seen(world: World) -> tuple[set[int], list[int]]:
    visible, (number, mask) = look(
        world.boxes(),
        jnp.int32(VIEWER),
        world.tilt,
        world.angle,
        jnp.asarray(world.points),
        jnp.asarray(world.present),
    )
    shown = np.asarray(number)[np.asarray(mask)]
    return set(np.flatnonzero(visible).tolist()), shown.tolist()


def visible_of(boxes: list[tuple], angle: float = 2.1) -> set[int]:
    """Returns which boxes (x, y, yaw, length, width) a viewer in the origin sees."""
    table = np.float32([(0, 0, 0, 4, 2), *boxes])
    size = np.concatenate([table[:, 3:], table[:, 4:]], axis=1)
    valid = np.ones(len(table), bool)
    visible = visible_objects(
        Boxes(*map(jnp.asarray, (table[:, :2], table[:, 2], size, valid))),
        jnp.int32(0),
        Cone(xy=jnp.zeros(2), yaw=jnp.float32(0), angle=angle, distance=REACH),
    )
    return set((np.flatnonzero(visible) - 1).tolist())


@pytest.mark.parametrize("seed", SEEDS)
def test_visible_boxes_are_those_that_some_ray_meets_first(seed: int) -> None:
    world = World(seed)
    others = world.others()
    expected = oracle.visible_boxes(world.view(), list(others.values()))
    assert seen(world)[0] == {list(others)[i] for i in expected}


@pytest.mark.parametrize("seed", SEEDS)
def test_points_are_the_nearest_that_no_visible_box_hides(seed: int) -> None:
    world = World(seed)
    visible, shown = seen(world)
    boxes = [world.others()[i] for i in visible]
    view, points = world.view(), np.float64(world.points)
    expected = [
        i
        for i, point in enumerate(points)
        if world.present[i]
        and oracle.contains(view, point)
        and not oracle.is_between(view, point, boxes)
    ]
    expected.sort(key=lambda i: np.linalg.norm(points[i] - view.xy))
    assert shown == expected


@pytest.mark.parametrize("seed", SEEDS)
def test_turning_and_shifting_the_world_changes_nothing(seed: int) -> None:
    world = World(seed)
    assert seen(world) == seen(world.moved(1.3, np.array([40.0, -90.0])))


def test_a_box_behind_a_wall_is_hidden_until_it_reaches_past_its_end() -> None:
    wall = (10.0, 0.0, np.pi / 2, 4.0, 1.0)  # hides from y = -4.2 to 4.2 at x = 20
    assert visible_of([wall, (20.0, 1.5, 0.0, 4.0, 2.0)]) == {0}
    assert visible_of([wall, (20.0, 3.5, 0.0, 4.0, 2.0)]) == {0, 1}


def test_a_gap_narrower_than_a_box_shows_it() -> None:
    walls = [(10.0, y, 0.0, 1.0, 4.99) for y in (2.5, -2.5)]
    assert visible_of([*walls, (20.0, 0.0, 0.0, 4.0, 2.0)]) == {0, 1, 2}


def test_the_part_of_a_box_that_is_out_of_reach_is_not_seen() -> None:
    far_end = REACH + 4.0
    long = (far_end, 0.0, 0.0, 10.0, 2.0)
    assert visible_of([long]) == {0}
    assert visible_of([(far_end, 0.0, 0.0, 6.0, 2.0)]) == set()
    # What of the long box is in reach, the wall hides.
    wall = (10.0, 0.0, np.pi / 2, 3.0, 1.0)
    oblique = (27.0, 10.0, 0.0, 30.0, 1.0)
    assert visible_of([oblique]) == {0}
    assert visible_of([wall, long]) == {0}


def test_a_box_that_only_reaches_into_the_cone_is_seen() -> None:
    beside = (5.0, 7.0, 0.0, 4.0, 2.0)
    assert visible_of([beside], angle=math.pi / 2) == {0}
    assert visible_of([beside], angle=math.pi / 4) == set()


def test_a_corner_that_pokes_through_the_face_of_a_wall_is_seen() -> None:
    wall = (10.0, 0.0, np.pi / 2, 12.0, 1.0)
    assert visible_of([wall, (10.8, 0.0, np.pi / 4, 4.0, 4.0)]) == {0, 1}
    assert visible_of([wall, (12.5, 0.0, np.pi / 4, 4.0, 4.0)]) == {0}


def test_a_wall_wider_than_the_cone_is_seen() -> None:
    assert visible_of([(5.0, 0.0, np.pi / 2, 60.0, 1.0)], angle=1.0) == {0}


def test_a_box_around_the_viewer_hides_what_is_outside_but_not_what_is_inside() -> None:
    around = (0.5, 0.0, 0.0, 12.0, 12.0)
    assert visible_of([around, (10.0, 0.0, 0.0, 4.0, 2.0)]) == {0}
    assert visible_of([around, (4.0, 0.0, 0.0, 2.0, 1.0)]) == {0, 1}


def test_a_cone_of_a_whole_turn_holds_what_is_behind() -> None:
    behind = (-10.0, 0.0, 0.0, 4.0, 2.0)
    assert visible_of([behind], angle=2 * math.pi) == {0}

    def holds_back(yaw):
        cone = Cone(xy=jnp.zeros(2), yaw=yaw, angle=2 * math.pi, distance=REACH)
        return cone.contains(-10 * jnp.array([[jnp.cos(yaw), jnp.sin(yaw)]]))

    assert jax.vmap(holds_back)(jnp.linspace(-np.pi, np.pi, 300)).all()


@pytest.mark.parametrize("angle", ANGLES)
def test_a_disc_touches_a_cone_if_a_point_of_it_lies_inside(angle: float) -> None:
    radius = 3.0
    rng = np.random.default_rng(0)
    centres = np.float32(rng.uniform(-1.2 * REACH, 1.2 * REACH, (300, 2)))
    cone = Cone(
        xy=jnp.array([2.0, 1.0]), yaw=jnp.float32(2.5), angle=angle, distance=REACH
    )
    view = oracle.View(np.array([2.0, 1.0]), 2.5, angle, REACH)
    turns = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rings = [0.0, 0.25, 0.5, 0.75, 1.0]
    grid = [radius * r * np.array([np.cos(t), np.sin(t)]) for r in rings for t in turns]
    inside = [any(oracle.contains(view, c + g) for g in grid) for c in centres]
    touches = np.asarray(cone.touches(jnp.asarray(centres), radius))
    assert touches[inside].all()
    # A disc that touches by less than the grid's step is missed by the grid.
    larger = np.asarray(cone.touches(jnp.asarray(centres), radius - 0.4))
    assert not larger[~np.array(inside)].any()
    assert 0 < larger.sum() < len(centres)
