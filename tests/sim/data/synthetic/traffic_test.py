"""Tests of generated traffic: following, changing lanes, and right of way."""

import dataclasses

import numpy as np
import pytest

from drivetrain.sim.data.synthetic import (
    courses,
    drivers as experts,
    lane_changes,
    network as networks,
    right_of_way,
    road,
    town as towns,
    traffic,
)
from drivetrain.sim.data.synthetic.courses import Rules
from drivetrain.sim.data.synthetic.drivers import Drivers
from drivetrain.sim.data.synthetic.lane_changes import Bodies
from drivetrain.sim.data.synthetic.profile import Profile
from drivetrain.sim.data.synthetic.right_of_way import Meetings
from drivetrain.sim.data.synthetic.town import Town
from drivetrain.sim.data.synthetic.traffic import Drive, Start
from drivetrain.sim.scenario import LightState

NUM_STEPS = 120
PROFILE = Profile(
    right=2,
    left=0,
    lane_width=3.5,
    shoulder=1.0,
    has_bike_lanes=False,
    median=0.0,
    limit=15.0,
)


def straight_road(profile: Profile = PROFILE) -> Rules:
    """Returns one road of 400 m, with lanes 0 and 1 side by side."""
    piece = road.road(np.zeros(500), profile, profile)
    town = Town(
        kind="road",
        pieces=(piece,),
        first_lane=np.array([0]),
        lanes=piece.lanes,
        successor=piece.successor,
        neighbor=piece.neighbor,
    )
    net = networks.network(np.random.default_rng(0), town, NUM_STEPS)
    return courses.rules(net)


def crew(num: int, **changed: float) -> Drivers:
    """Returns drivers who are all alike, but for what is changed."""
    drawn = experts.draw(np.random.default_rng(0), np.zeros(num, bool))
    alike = {
        "desired": 1.0,
        "headway": 1.5,
        "acceleration": 1.5,
        "braking": 2.0,
        "standstill": 2.0,
        "aside": 2.0,
        "reaction": 0.3,
        "courtesy": 0.2,
    } | changed
    return dataclasses.replace(
        drawn,
        size=np.tile([4.5, 2.0, 1.5], (num, 1)),
        **{name: np.full(num, value) for name, value in alike.items()},
    )


def driven(
    rules: Rules, drivers: Drivers, ways: list[tuple[int, ...]], station, speed
) -> Drive:
    start = Start(
        ways=tuple(ways),
        station=np.array(station, float),
        speed=np.array(speed, float),
    )
    is_walked = np.zeros((NUM_STEPS, len(rules.walk_point) + 1), bool)
    return traffic.drive(np.random.default_rng(1), rules, drivers, start, is_walked)


def test_a_fast_driver_stays_behind_a_slow_one() -> None:
    one_lane = dataclasses.replace(PROFILE, right=1)
    drivers = crew(2)
    drivers = dataclasses.replace(drivers, desired=np.array([0.3, 1.0]))
    drive = driven(straight_road(one_lane), drivers, [(0,), (0,)], [80, 40], [4, 14])
    gap = drive.station[:, 0] - drive.station[:, 1] - 4.5
    assert gap.min() > 1.5
    # At rest with each other, IDM keeps at least s0 + v T.
    assert 2.0 + 1.5 * 4.0 < gap[-1] < 14.0
    assert drive.speed[-1, 1] == pytest.approx(4.5, abs=1.0)


def test_a_fast_driver_overtakes_where_there_is_a_lane() -> None:
    drivers = dataclasses.replace(crew(2), desired=np.array([0.3, 1.0]))
    drive = driven(straight_road(), drivers, [(0,), (0,)], [70, 40], [4, 12])
    assert len(drive.ways) > 2  # somebody took another way
    assert drive.station[-1, 1] > drive.station[-1, 0]
    # The change is smooth: no step aside is larger than the slope allows.
    aside = np.abs(np.diff(drive.left[:, 1]))
    assert np.sort(aside)[-2] < 0.3


def bodies(lane: list[int], middle: list[float], speed: list[float]) -> Bodies:
    length = np.full(len(lane), 4.5)
    return Bodies(
        lane=np.array(lane),
        rear=np.array(middle) - 2.25,
        length=length,
        speed=np.array(speed, float),
    )


@pytest.mark.parametrize(
    ("lane", "middle", "speed", "changes"),
    [
        ([0, 0], [100, 115], [12, 4], True),  # a slow one ahead, nobody beside
        ([0, 0], [100, 300], [12, 12], False),  # nothing to win
        ([0, 0, 1], [100, 115, 102], [12, 4, 12], False),  # somebody is beside
        ([0, 0, 1], [100, 115, 88], [12, 4, 15], False),  # one comes fast behind
        ([0, 0, 1], [100, 115, 40], [12, 4, 12], True),  # one follows far behind
        ([0, 0, 1], [100, 115, 112], [12, 4, 4], False),  # no better over there
    ],
)
def test_mobil_changes_where_it_pays_and_is_safe(
    lane: list[int], middle: list[float], speed: list[float], changes: bool
) -> None:
    rules = straight_road()
    may = np.arange(len(lane)) == 0
    wishes = lane_changes.wishes(
        rules.network,
        crew(len(lane)),
        bodies(lane, middle, speed),
        np.array(middle, float),
        may,
    )
    assert [w[:2] for w in wishes] == ([(0, 1)] if changes else [])


def test_a_change_begins_beside_and_ends_in_the_lane() -> None:
    rules = straight_road()
    started = lane_changes.started(
        lane_changes.none(1), rules.network, 0, (0, 1), (100.0, 100.0), 10.0
    )
    # Lane 1 is 3.5 m right of lane 0: one begins left of it.
    left, slope = lane_changes.beside(started, np.array([100.0]))
    assert left == pytest.approx(3.5, abs=1e-3) and slope == 0.0
    left, slope = lane_changes.beside(started, np.array([140.0]))
    assert abs(left[0]) < 1e-9 and slope == 0.0
    # In the middle u = 1/2: half the way, slope 15/8 of the mean.
    left, slope = lane_changes.beside(started, np.array([120.0]))
    assert left == pytest.approx(1.75, abs=1e-3)
    assert slope == pytest.approx(-3.5 / 40 * 15 / 8, rel=1e-3)


def meeting(**changed: list[float]) -> Meetings:
    """Returns two drivers before the sides 0 and 1 of one zone."""
    values = {
        "to_begin": [10.0, 10.0],
        "to_end": [20.0, 20.0],
        "to_hold": [8.0, 8.0],
        "time_in": [2.0, 2.0],
        "time_out": [4.0, 4.0],
        "turn": [0.0, 1.0],
    } | changed
    return Meetings(
        driver=np.array([0, 1]),
        side=np.array([0, 1]),
        **{name: np.array(value) for name, value in values.items()},
    )


@pytest.mark.parametrize(
    ("changed", "yields", "walls"),
    [
        ({}, [1, -1], [8.0, np.inf]),  # the lower rank waits
        ({}, [-1, 1], [np.inf, 8.0]),
        ({}, [0, 0], [np.inf, 8.0]),  # among equals the first in turn goes
        ({"time_in": [2.0, 8.0], "time_out": [4.0, 9.0]}, [1, -1], [np.inf, np.inf]),
        ({"to_begin": [10.0, -1.0]}, [-1, 1], [8.0, np.inf]),  # one is inside
        ({"to_hold": [0.5, 8.0]}, [1, -1], [np.inf, np.inf]),  # too late to stop
    ],
)
def test_right_of_way(changed: dict, yields: list[int], walls: list[float]) -> None:
    speed = np.array([4.0, 4.0])
    found = right_of_way.waits_for_others(
        meeting(**changed), np.array(yields), speed, np.zeros(2, bool)
    )
    np.testing.assert_array_equal(found, walls)


def test_who_is_held_by_a_light_claims_nothing() -> None:
    found = right_of_way.waits_for_others(
        meeting(), np.array([1, -1]), np.array([4.0, 4.0]), np.array([False, True])
    )
    np.testing.assert_array_equal(found, [np.inf, np.inf])


def test_the_travel_time_is_that_of_constant_acceleration() -> None:
    # From rest over 20 m at 1.3 m/s^2: sqrt(2 20 / 1.3); 0.1 m/s guards against zero.
    time = right_of_way.travel_time(np.array([20.0]), np.zeros(1), np.array([99.0]))
    assert time == pytest.approx(np.sqrt(40 / 1.3), rel=0.02)
    time = right_of_way.travel_time(np.array([20.0]), np.array([10.0]), np.zeros(1))
    assert time == pytest.approx(2.0, rel=0.01)


def lit_network(seed: int) -> networks.Network:
    """Returns the network of a town with lights, from some seed on."""
    for number in range(100 * seed, 100 * seed + 100):
        town = towns.draw(np.random.default_rng(number), "junction")
        net = networks.network(np.random.default_rng(seed), town, NUM_STEPS)
        if len(net.lit) > 10:
            return net
    raise AssertionError("no town has lights")


def passed(net: networks.Network, drive: Drive, length: float) -> list[int]:
    """Returns what the lights show whose lines a front passes in some step."""
    shown = []
    for driver in range(drive.way.shape[1]):
        for t in range(1, NUM_STEPS):
            way = drive.ways[drive.way[t, driver]]
            begin = np.cumsum([0.0, *net.length[list(way)]])
            front = drive.station[t - 1 : t + 1, driver] + length / 2
            for lane, line in zip(way, begin, strict=False):
                if net.light[lane] >= 0 and front[0] < line <= front[1]:
                    shown.append(int(net.light_state[net.light[lane], t - 1]))
    return shown


def test_nobody_passes_a_red_light() -> None:
    shown = []
    for seed in range(3):
        net = lit_network(seed)
        draw = np.random.default_rng(seed)
        before = sorted({a for a, b in net.town.successor if net.light[b] >= 0})
        before = [lane for lane in before if net.length[lane] > 45.0]
        ways = [courses.follow(draw, net, lane, 250.0) for lane in before]
        station = [float(net.length[lane]) - draw.uniform(20, 40) for lane in before]
        speed = 0.6 * net.limit[before]
        drive = driven(courses.rules(net), crew(len(ways)), ways, station, speed)
        shown += passed(net, drive, 4.5)
    assert len(shown) >= 5
    assert not set(shown) & {LightState.STOP, LightState.ARROW_STOP}


def test_those_who_meet_in_a_town_brake_gently() -> None:
    town = towns.draw(np.random.default_rng(5), "junction")
    net = networks.network(np.random.default_rng(0), town, NUM_STEPS)
    rules = courses.rules(net)
    generator = np.random.default_rng(2)
    lanes = [
        i
        for i, lane in enumerate(town.lanes)
        if lane.turn is None and net.length[i] > 40.0 and net.is_driven[i]
    ]
    ways = [courses.follow(generator, net, lane, 250.0) for lane in lanes]
    station = [float(net.length[lane]) - 30.0 for lane in lanes]
    drive = driven(rules, crew(len(ways)), ways, station, [8.0] * len(ways))
    assert drive.speed.max() < 22.0
    assert (drive.speed.max(axis=0) > 3.0).any()
    accelerations = np.diff(drive.speed, axis=0) / 0.1
    assert accelerations.min() > -5.1 and accelerations.max() < 3.0
