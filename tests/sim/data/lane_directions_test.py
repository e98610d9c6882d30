"""Tests that lights face the way that their lanes are driven."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.data import parts
from drivetrain.sim.data.lane_directions import (
    lane_directions,
    stop_sign_directions,
)
from drivetrain.sim.data.parts import seen_lights
from drivetrain.sim.scenario import LANES, Lights, MapType, Polylines
from drivetrain.sim.scene import Scene
from drivetrain.sim.scene_records import Lights as SceneLights
from tests import worlds
from tests.oracles import geometry

ROUNDING = 1e-9  # radians: float64
FLOAT32 = 1e-6  # radians: some roundings of numbers up to pi


@jax.jit
def lights_at(scene: Scene, step: jax.Array) -> SceneLights:
    """Returns the lights of a step."""
    return scene.lights_at(step)


def on_lane(xy: tuple[float, float], lane_id: int = 7) -> tuple[float, bool]:
    """Returns the direction of a light beside a lane that goes east, then north."""
    lane = np.array([(0.0, 0, 0), (10, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)])
    roads = Polylines(
        xyz=np.concatenate([lane[::-1], lane]),
        offset=np.array([0, 5, 10]),
        map_type=np.array([MapType.EDGE_BOUNDARY, MapType.LANE_FREEWAY]),
        feature_id=np.array([7, 7]),
    )
    lights = Lights(
        lane_id=np.array([lane_id]),
        xyz=np.array([[*xy, 0.0]]),
        state=np.ones((1, 3), int),
        valid=np.ones((1, 3), bool),
    )
    yaw, has_lane = lane_directions(lights.lane_id, lights.xyz, roads)
    return float(yaw[0]), bool(has_lane[0])


@pytest.mark.parametrize(
    ("xy", "yaw"),
    [
        ((0, 0), 0.0),
        ((4, 1.5), 0.0),
        ((10, 0), 0.0),
        ((11, 5), np.pi / 2),
        ((3, 11), np.pi),
        ((-1, 10), np.pi),
    ],
)
def test_the_nearest_piece_of_the_lane_gives_the_direction(xy, yaw) -> None:
    assert on_lane(xy) == (pytest.approx(yaw, abs=ROUNDING), True)


@pytest.mark.parametrize(("xy", "lane_id"), [((4, 0), 8), ((4, -2.1), 7)])
def test_a_lane_that_is_elsewhere_or_nowhere_gives_no_direction(xy, lane_id) -> None:
    assert on_lane(xy, lane_id) == (0.0, False)


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_scenes_show_the_directions_of_the_oracle(kind: str) -> None:
    num_lanes = 0
    for number, scenario in enumerate(worlds.scenarios(kind)):
        seen = seen_lights(scenario.lights)
        scene = worlds.scene(worlds.bank(kind), number)
        for step in (11, 60):
            shown = lights_at(scene, jnp.int32(step))
            for i in np.flatnonzero(seen.valid[:, step]):
                roads = scenario.roads
                is_lane = np.isin(roads.map_type, LANES)
                is_lane &= roads.feature_id == seen.lane_id[i]
                assert shown.has_lane[i] == is_lane.any()
                num_lanes += is_lane.sum()
                if is_lane.any():
                    lane = roads.points_of(int(np.argmax(is_lane)))[:, :2]
                    yaw = geometry.direction_at(seen.xyz[i, :2], lane)
                    turn = geometry.wrap_angle(float(shown.yaw[i]) - yaw)
                    assert abs(turn) < FLOAT32
        assert not shown.has_lane[~np.asarray(shown.valid)].any()
        assert not shown.yaw[~np.asarray(shown.has_lane)].any()
    assert num_lanes > 10  # else the scenarios prove nothing


def test_a_stop_sign_faces_the_first_lane_that_it_stops() -> None:
    lane = np.array([(0.0, 0, 0), (10, 0, 0)])
    roads = Polylines(
        xyz=np.concatenate(
            [lane, lane[::-1], [(10, -4, 0)], [(90, 0, 0)], [(5, 2, 0)]]
        ),
        offset=np.array([0, 2, 4, 5, 6, 7]),
        map_type=np.array([2, 2, 17, 17, 17]),
        feature_id=np.array([3, 4, 8, 9, 7]),
    )
    links = parts.lane_links([], [], [(8, 4), (8, 5), (9, 3)], {})
    yaw, is_known = stop_sign_directions(roads, links)
    # The first stops lane 4, which leads west; the second's lane is 80 m away, and
    # nobody tells the third's.
    np.testing.assert_allclose(yaw, [np.pi, 0, 0], atol=ROUNDING)
    assert is_known.tolist() == [True, False, False]
    assert not stop_sign_directions(roads, None)[1].any()
