"""Tests what an entry says of a scenario made by hand."""

import numpy as np
import pytest

from drivetrain.sim.data.entry import Entry, entry_of
from drivetrain.sim.data.pack import PackConfig, pack
from tests.sim.data import by_hand

STEPS = 91
STRAIGHT = np.stack([np.linspace(-20, 70, STEPS), *np.zeros((2, STEPS))], axis=-1)


def lane(angle: float, *, offset: float = 0.0, height: float = 0.0) -> np.ndarray:
    """Returns a lane of 80 m through (25 m, offset), turned from the ego's way."""
    along = np.linspace(-40.0, 40.0, 81)[:, None]
    direction = np.array([[np.cos(angle), np.sin(angle), 0.0]])
    return np.array([25.0, offset, height]) + along * direction


def entry_with(*lanes: np.ndarray, others: tuple[np.ndarray, ...] = ()) -> Entry:
    """Returns the entry of an ego at 10 m/s along x, with lanes and other cars."""
    xyz = np.stack([STRAIGHT, *others])
    roads = dict(enumerate([STRAIGHT, *lanes]))
    scenario = by_hand.cars_on(roads, xyz, np.zeros(xyz.shape[:2]), (2.0, 2.0, 2.0))
    return entry_of(pack(scenario, PackConfig()))


@pytest.mark.parametrize(
    ("degrees", "is_crossing"), [(90, True), (33, True), (147, True), (27, False)]
)
def test_a_lane_crosses_at_thirty_degrees_or_more(degrees, is_crossing):
    found = entry_with(lane(np.radians(degrees)))

    assert found.is_at_junction == is_crossing


@pytest.mark.parametrize(("gap", "is_near"), [(5.9, True), (6.2, False)])
def test_a_lane_crosses_within_six_metres(gap, is_near):
    # Forty metres to one side: its end is the nearest to the way.
    found = entry_with(lane(np.pi / 2, offset=40.0 + gap))

    assert found.is_at_junction == is_near


@pytest.mark.parametrize(("height", "is_level"), [(2.9, True), (8.0, False)])
def test_a_lane_on_a_bridge_does_not_cross(height, is_level):
    assert entry_with(lane(np.pi / 2, height=height)).is_at_junction == is_level


def follower(seconds: float, *, height: float = 0.0) -> np.ndarray:
    """Returns a car that is where the ego is, some time later."""
    return STRAIGHT + np.array([-10.0 * seconds, 0.0, height])


@pytest.mark.parametrize("seconds", [1.0, 3.0])
def test_who_follows_is_met_as_much_later_as_it_follows(seconds):
    found = entry_with(others=(follower(seconds),)).encounter

    # Within 2.5 m, 0.25 s at 10 m/s, seen every 0.2 s.
    assert found == pytest.approx(seconds - 0.2, abs=1e-6)


def test_who_is_on_a_bridge_is_not_met():
    assert entry_with(others=(follower(1.0, height=8.0),)).encounter is None


@pytest.mark.parametrize(("reach", "is_met"), [(0.5, False), (1.2, True)])
def test_who_jitters_does_not_move(reach, is_met):
    rng = np.random.default_rng(0)
    parked = np.array([25.0, 2.0, 0.0]) + rng.uniform(-0.2, 0.2, (STEPS, 3))
    parked[-1] = parked[0] + [reach, 0.0, 0.0]

    assert (entry_with(others=(parked,)).encounter is not None) == is_met
