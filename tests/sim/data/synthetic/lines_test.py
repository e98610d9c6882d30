"""Tests of the lines of generated maps."""

import numpy as np
import pytest

from drivetrain.sim.data.synthetic import lines
from drivetrain.sim.data.synthetic.lines import Pose

ROUNDING = 1e-9  # metres and radians: a hundred products in float64, 200 m away
# Radians: an edge of 0.8 m of an arc of 6 m is turned by half its angle, 0.07.
EDGE_TURN = 0.08


@pytest.mark.parametrize(
    "end",
    [
        Pose(20.0, 15.0, np.pi / 2),
        Pose(12.0, -8.0, -np.pi / 2),
        Pose(30.0, 9.0, 0.6),
        Pose(40.0, 3.5, 0.0),
        Pose(25.0, -1.0, -0.1),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_joint_leads_from_pose_to_pose(end: Pose, yaw: float) -> None:
    begin = Pose(100.0, -50.0, yaw)
    end = lines.ahead(begin, end.x, end.y, end.yaw)
    line = lines.join(begin, end)
    np.testing.assert_allclose(line[0], begin[:2], atol=ROUNDING)
    np.testing.assert_allclose(line[-1], end[:2], atol=ROUNDING)
    edge = np.diff(line, axis=0)
    heading = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
    assert abs(lines.wrap(heading[0] - begin.yaw)) < EDGE_TURN
    assert abs(lines.wrap(heading[-1] - end.yaw)) < EDGE_TURN
    length = np.linalg.norm(edge, axis=1)
    assert length.min() > 0.6 and length.max() < 1.1
    # No tighter than a car can turn.
    assert np.abs(np.diff(heading) / length[1:]).max() < 0.25


def test_placing_undoes_seeing() -> None:
    xy = np.random.default_rng(0).normal(0, 50, (20, 2))
    pose = Pose(3.0, -7.0, 2.5)
    there = lines.placed(lines.seen_from(xy, pose), pose)
    np.testing.assert_allclose(there, xy, atol=ROUNDING)


def test_an_offset_line_is_so_far_away() -> None:
    xy, yaw = lines.bend(np.full(50, 0.02), 1.0)
    away = np.linalg.norm(lines.offset(xy, yaw, -3.5) - xy, axis=1)
    np.testing.assert_allclose(away, 3.5, atol=ROUNDING)


def test_a_bend_turns_by_its_angle() -> None:
    _, yaw = lines.bend(lines.arc(1.2, 40) / 0.8, 0.8)
    assert yaw[-1] == pytest.approx(1.2)


def test_resampling_keeps_the_ends_and_the_spacing() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.1]])
    dense = lines.resample(line)
    np.testing.assert_array_equal(dense[[0, -1]], line[[0, -1]])
    assert lines.stations(line)[-1] == pytest.approx(15.1)
    assert np.ptp(np.linalg.norm(np.diff(dense, axis=0), axis=1)) < 0.25


def test_the_grid_is_a_65536th() -> None:
    values = np.random.default_rng(1).normal(0, 100, 50)
    snapped = lines.snap(values)
    assert (np.abs(snapped - values) <= 2.0**-17).all()
    assert (snapped * 2**16 == np.round(snapped * 2**16)).all()
    assert lines.snapped(float(values[0])) == snapped[0]
