"""Tests that pictures show what is there, where it is, and nothing else."""

import dataclasses
import io

import numpy as np
import pytest
from matplotlib import colors, figure, image

from drivetrain.sim.data import parts
from drivetrain.sim.scenario import (
    Lights,
    LightState,
    MapType,
    ObjectType,
    Polylines,
    Scenario,
    Tracks,
)
from drivetrain.sim.visualization import objects, scene, trajectory

NUM_STEPS = 31
COLOR_TOLERANCE = 0.02  # of 1: a PNG holds 8 bits, and nothing is blended inside a box
TYPES = (
    ObjectType.VEHICLE,
    ObjectType.VEHICLE,
    ObjectType.CYCLIST,
    ObjectType.PEDESTRIAN,
)


@pytest.fixture
def scenario() -> Scenario:
    """A road of 200 m along x; the ego drives on it, the others stand beside it."""
    place = np.array(
        [(4000.0, 9000.0), (4000.0, 9015.0), (3985.0, 9000.0), (4020.0, 8990.0)]
    )
    xyz = np.zeros((4, NUM_STEPS, 3))
    xyz[..., :2] = place[:, None]
    xyz[0, :, 0] += np.arange(NUM_STEPS)
    runs = [
        (MapType.LANE_SURFACE_STREET, [(3900.0, 9000.0), (4100.0, 9000.0)]),
        (MapType.EDGE_BOUNDARY, [(3900.0, 8997.0), (4100.0, 8997.0)]),
        (MapType.LINE_BROKEN_SINGLE_WHITE, [(3900.0, 9002.0), (4100.0, 9002.0)]),
        (MapType.CROSSWALK, [(4030.0, 8997.0), (4034.0, 8997.0), (4034.0, 9003.0)]),
        (MapType.STOP_SIGN, [(4010.0, 8995.0)]),
        (MapType.EDGE_MEDIAN, [(8000.0, 8997.0), (8100.0, 8997.0)]),
    ]
    points = [np.array(run) for _, run in runs]
    offset = np.cumsum([0, *(len(run) for run in points)])
    flat = np.concatenate(points)
    return Scenario(
        scenario_id="hand-made",
        dataset="test",
        tracks=Tracks(
            object_id=np.arange(4),
            object_type=np.array([int(kind) for kind in TYPES]),
            xyz=xyz,
            yaw=np.zeros((4, NUM_STEPS)),
            velocity=np.zeros((4, NUM_STEPS, 2)),
            valid=np.ones((4, NUM_STEPS), bool),
            size=np.tile([4.5, 2.0, 1.5], (4, 1)),
            is_of_interest=np.zeros(4, bool),
        ),
        ego_index=0,
        ego_source="marked",
        roads=Polylines(
            xyz=np.column_stack([flat, np.zeros(len(flat))]),
            offset=offset,
            map_type=np.array([int(kind) for kind, _ in runs]),
            feature_id=np.arange(len(runs)),
        ),
        lights=Lights(
            lane_id=np.array([0]),
            xyz=np.array([[4015.0, 9005.0, 0.0]]),
            state=np.full((1, NUM_STEPS), int(LightState.STOP)),
            valid=np.ones((1, NUM_STEPS), bool),
        ),
        lane_links=parts.lane_links([], [], [], {}),
    )


def drawn(scenario: Scenario, motion: trajectory.Trajectory, step: int) -> list[str]:
    """Draws on axes of its own and returns the words of the legend."""
    ax = figure.Figure(figsize=(4, 4)).add_axes((0, 0, 1, 1))
    return scene.draw(ax, scenario, motion, step)


def pixels(scenario: Scenario, motion: trajectory.Trajectory, step: int) -> np.ndarray:
    """Returns an image of 80 m with 10 pixels a metre, the ego in the middle."""
    fig = figure.Figure(figsize=(8, 8))
    scene.draw(fig.add_axes((0, 0, 1, 1)), scenario, motion, step)
    png = scene.to_png(fig, dpi=100)
    return image.imread(io.BytesIO(png))[..., :3]


def color_at(picture: np.ndarray, x: float, y: float) -> np.ndarray:
    """Returns the colour at a place relative to the ego [m]."""
    return picture[round((40 - y) * 10), round((40 + x) * 10)]


def test_boxes_are_drawn_where_the_objects_are(scenario: Scenario) -> None:
    picture = pixels(scenario, trajectory.logged(scenario), 0)
    expected = {
        (-1.0, 0.5): objects.EGO,
        (-1.0, 15.5): objects.KINDS["vehicle"][0],
        (-16.0, 0.5): objects.KINDS["cyclist"][0],
        (19.0, -9.5): objects.KINDS["pedestrian"][0],
    }
    for (x, y), color in expected.items():
        found = color_at(picture, x, y)
        np.testing.assert_allclose(found, colors.to_rgb(color), atol=COLOR_TOLERANCE)


def test_moving_map_and_objects_together_keeps_the_picture(scenario: Scenario) -> None:
    shift = np.array([1000.0, -500.0, 0.0])
    moved = dataclasses.replace(
        scenario,
        tracks=dataclasses.replace(scenario.tracks, xyz=scenario.tracks.xyz + shift),
        roads=dataclasses.replace(scenario.roads, xyz=scenario.roads.xyz + shift),
        lights=dataclasses.replace(scenario.lights, xyz=scenario.lights.xyz + shift),
    )
    before = pixels(scenario, trajectory.logged(scenario), 20)
    after = pixels(moved, trajectory.logged(moved), 20)
    np.testing.assert_array_equal(before, after)


def test_absent_objects_leave_no_trace(scenario: Scenario) -> None:
    motion = trajectory.logged(scenario)
    valid = motion.valid.copy()
    valid[:, 2] = False
    gone = dataclasses.replace(motion, valid=valid)
    in_sight = motion.xy[:, :1] + np.random.default_rng(0).uniform(-30, 30, (31, 4, 2))
    elsewhere = dataclasses.replace(
        gone, xy=np.where(valid[..., None], gone.xy, in_sight)
    )
    np.testing.assert_array_equal(
        pixels(scenario, gone, 20), pixels(scenario, elsewhere, 20)
    )
    assert "cyclist" not in drawn(scenario, gone, 20)


def test_the_legend_names_what_is_to_be_seen(scenario: Scenario) -> None:
    shown = drawn(scenario, trajectory.logged(scenario), 0)
    assert sorted(shown) == sorted(
        [
            "ego",
            "logged ego",
            "vehicle",
            "cyclist",
            "pedestrian",
            "stop sign",
            "red light",
        ]
    )


def test_the_legend_passes_over_what_is_out_of_sight(scenario: Scenario) -> None:
    xy = scenario.tracks.xyz.copy()
    xy[3, :, 0] += 500.0
    far = dataclasses.replace(
        scenario, tracks=dataclasses.replace(scenario.tracks, xyz=xy)
    )
    assert "pedestrian" not in drawn(far, trajectory.logged(far), 0)


@pytest.mark.parametrize(("step", "is_marked"), [(11, False), (12, True), (30, True)])
def test_an_event_is_marked_from_when_it_happens(
    scenario: Scenario, step: int, is_marked: bool
) -> None:
    motion = trajectory.logged(scenario)
    flags = np.zeros(motion.valid.shape, bool)
    flags[12, 0] = True
    shown = drawn(scenario, dataclasses.replace(motion, collision=flags), step)
    assert ("collision" in shown) == is_marked


def test_a_rollout_that_begins_later_is_drawn_at_its_own_steps(
    scenario: Scenario,
) -> None:
    log = trajectory.logged(scenario)
    rollout = trajectory.Trajectory(
        xy=log.xy[10:], yaw=log.yaw[10:], valid=log.valid[10:], start=10
    )
    # Older trails fade, so only the box and what lies ahead of it is the same.
    np.testing.assert_array_equal(
        pixels(scenario, rollout, 15)[:, 380:], pixels(scenario, log, 15)[:, 380:]
    )


def test_a_map_without_features_in_sight_is_drawn(scenario: Scenario) -> None:
    xyz = scenario.roads.xyz + 1e5
    far = dataclasses.replace(
        scenario, roads=dataclasses.replace(scenario.roads, xyz=xyz)
    )
    assert "ego" in drawn(far, trajectory.logged(far), 0)


@pytest.mark.parametrize("step", [-1, NUM_STEPS])
def test_a_step_that_does_not_exist_is_refused(scenario: Scenario, step: int) -> None:
    with pytest.raises(ValueError, match=f"0 to 30, .*; got {step}"):
        drawn(scenario, trajectory.logged(scenario), step)


def test_the_motion_of_other_objects_is_refused(scenario: Scenario) -> None:
    motion = trajectory.logged(scenario)
    fewer = trajectory.Trajectory(
        xy=motion.xy[:, :2], yaw=motion.yaw[:, :2], valid=motion.valid[:, :2]
    )
    with pytest.raises(ValueError, match="has 2 objects, scenario hand-made has 4"):
        drawn(scenario, fewer, 0)


def test_pictures_side_by_side_share_one_legend(scenario: Scenario) -> None:
    motion = trajectory.logged(scenario)
    panels = [
        scene.Panel(title=f"agent {i}", scenario=scenario, trajectory=motion, step=20)
        for i in range(3)
    ]
    fig = scene.figure(panels)
    assert [ax.get_title(loc="left") for ax in fig.axes] == [
        "agent 0",
        "agent 1",
        "agent 2",
    ]
    (legend,) = fig.legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts.count("ego") == 1
    assert len(texts) == len({*texts})
