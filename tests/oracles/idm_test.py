"""Tests of the IDM oracle by numbers worked by hand."""

import math

import numpy as np
import pytest

from tests.oracles import idm

ROUNDING = 1e-12  # float64, a few operations on numbers up to 100
CAR = (4.0, 2.0, 1.5)
PEDESTRIAN = 2


def scene(*tracks: np.ndarray) -> idm.Log:
    """Returns a log of cars from runs of (x, y, yaw), with their velocity at 10 Hz."""
    pose = np.array(tracks, dtype=float)
    moved = np.diff(pose[..., :2], axis=1) / 0.1
    return idm.Log(
        xyz=np.concatenate([pose[..., :2], np.zeros_like(pose[..., :1])], axis=-1),
        yaw=pose[..., 2],
        velocity=np.concatenate([moved, moved[:, -1:]], axis=1),
        valid=np.ones(pose.shape[:2], bool),
        size=np.tile(CAR, (len(pose), 1)),
        object_type=np.full(len(pose), idm.VEHICLE),
    )


def world(log: idm.Log, step: int = 0) -> idm.World:
    """Returns the world as logged."""
    return idm.World(
        log.xyz[:, step, :2],
        log.yaw[:, step],
        log.velocity[:, step],
        log.valid[:, step],
    )


def eastward(x: float, y: float, speed: float, steps: int = 11) -> np.ndarray:
    """Returns a track that drives east."""
    return np.array([(x + speed * 0.1 * t, y, 0.0) for t in range(steps)])


def oracle(log: idm.Log) -> idm.IdmOracle:
    """Returns the oracle with the parameters of the paper."""
    return idm.IdmOracle(log, 0, idm.Params())


@pytest.mark.parametrize(
    ("speed", "leader", "expected"),
    [
        (0, None, 2),
        (15, None, 1.875),  # 2 (1 - 1 / 16)
        (30, None, 0),
        (0, idm.Leader(gap=4, speed=0), 1.5),  # s* = 2
        (30, idm.Leader(gap=31, speed=30), -8),  # s* = 62
        # s* = 2 + 20 + 10 * 4 / (4 sqrt 2) = 22 + 5 sqrt 2
        (
            10,
            idm.Leader(gap=20, speed=6),
            2 * (80 / 81 - ((22 + 5 * 2**0.5) / 20) ** 2),
        ),
        # The leader draws away so fast that the desired gap is the least: s* = 2.
        (10, idm.Leader(gap=4, speed=40), 2 * (80 / 81 - 0.25)),
    ],
)
def test_acceleration(speed: float, leader: idm.Leader | None, expected: float) -> None:
    acceleration = idm.acceleration(speed, leader, idm.Params())
    assert acceleration == pytest.approx(expected, abs=ROUNDING)


def test_a_free_car_speeds_up_along_its_path() -> None:
    # From 15 m/s with 1.875 m/s^2: v' = 15.1875, s' = 1.509375, along (0.6, 0.8).
    yaw = math.atan2(0.8, 0.6)
    log = scene(np.array([(5 + 0.9 * t, 3 + 1.2 * t, yaw) for t in range(11)]))
    target = oracle(log).step(world(log))
    np.testing.assert_allclose(target.xy, [(5.905625, 4.2075)], atol=ROUNDING)
    np.testing.assert_allclose(target.yaw, [yaw], atol=ROUNDING)
    np.testing.assert_allclose(target.velocity, [(9.1125, 12.15)], atol=ROUNDING)


def test_equilibrium_gap_holds_the_speed() -> None:
    gap = 22 / math.sqrt(80 / 81)  # s* = 2 + 10 * 2, 1 - (10 / 30)^4 = 80 / 81
    log = scene(eastward(0, 0, 10), eastward(gap + 4, 0, 10))
    agents = oracle(log)
    leader = agents.leader(0, world(log))
    assert leader == pytest.approx((gap, 10), abs=ROUNDING)
    target = agents.step(world(log))
    np.testing.assert_allclose(target.xy[0], (1, 0), atol=ROUNDING)
    np.testing.assert_allclose(target.velocity[0], (10, 0), atol=ROUNDING)


def test_a_platoon_settles_at_the_equilibrium_gap() -> None:
    # The first car is played back at 10 m/s; the second starts 11 m behind it.
    log = scene(eastward(0, 0, 10, 801), eastward(15, 0, 10, 801))
    agents = oracle(log)
    now = world(log)
    for step in range(1, 801):
        logged, target = world(log, step), agents.step(now)
        now = logged._replace(
            xy=np.array([target.xy[0], logged.xy[1]]),
            velocity=np.array([target.velocity[0], logged.velocity[1]]),
        )
    gap = now.xy[1, 0] - now.xy[0, 0] - 4
    settled = 1e-9  # metres; linearized there, 11 m decay as exp(-0.34 t), over 80 s
    assert gap == pytest.approx(22 / math.sqrt(80 / 81), abs=settled)


def test_a_car_brakes_to_a_stop_and_never_backs() -> None:
    log = scene(eastward(0, 0, 1), eastward(4.5, 0, 0))
    agents = oracle(log)
    target = agents.step(world(log))
    np.testing.assert_allclose(target.xy[0], (0.05, 0), atol=ROUNDING)  # (1 + 0) / 2 dt
    np.testing.assert_allclose(target.velocity[0], (0, 0), atol=ROUNDING)


def test_a_leader_at_contact_keeps_a_least_gap() -> None:
    log = scene(eastward(0, 0, 1), eastward(9, 0, 1))
    close = world(log)._replace(xy=np.array([(0.0, 0), (3.0, 0)]))
    assert oracle(log).leader(0, close) == (idm.MIN_GAP, pytest.approx(1))


def test_the_leader_is_the_box_met_first() -> None:
    # Rears at 18 and 28 m; the one that stands beside the lane by 0.1 m is passed.
    cars = [eastward(x, y, 10) for x, y in ((0, 0), (30, 0), (20, 0.5), (12, 2.1))]
    log = scene(*cars)
    assert oracle(log).leader(0, world(log)) == pytest.approx((16, 10), abs=ROUNDING)


def test_of_leaders_abreast_the_first_leads() -> None:
    log = scene(eastward(0, 0, 10), eastward(20, 1.1, 7), eastward(20, -1.1, 8))
    assert oracle(log).leader(0, world(log)) == pytest.approx((16, 7), abs=ROUNDING)


def test_what_is_not_valid_or_out_of_sight_does_not_lead() -> None:
    log = scene(eastward(0, 0, 10), eastward(20, 0, 10), eastward(52.1, 0, 10))
    now = world(log)._replace(valid=np.array([True, False, True]))
    assert oracle(log).leader(0, now) is None
    nearer = now._replace(xy=np.array([(0.0, 0), (20, 0), (51.9, 0)]))
    leader = oracle(log).leader(0, nearer)
    assert leader == pytest.approx((47.9, 10), abs=ROUNDING)


def bend() -> np.ndarray:
    """Returns a track that drives 10 m east and then north at 10 m/s."""
    east = [(t, 0, 0) for t in range(10)]
    return np.array(east + [(10, t, math.pi / 2) for t in range(31)])


def test_the_search_bends_with_the_path() -> None:
    # The rear of the car at (10, 20) is at y = 18, in chord 5, which starts at y = 15
    # after 25 m: contact 28 m. Of its (3, 4) m/s, 4 are along the chord.
    north = np.tile((10.0, 20.0, math.pi / 2), (len(bend()), 1))
    straight_on = np.tile((20.0, 0.0, 0.0), (len(bend()), 1))
    log = scene(bend(), north, straight_on)
    now = world(log)._replace(velocity=np.array([(10.0, 0), (3, 4), (0, 0)]))
    leader = oracle(log).leader(0, now)
    assert leader == pytest.approx((28 - 2, 4), abs=ROUNDING)


def test_a_box_that_begins_before_its_chord_is_met_at_its_start() -> None:
    # From y = -0.7 to 1.3, it is right of chord 1 and reaches into chord 2, from 10 m.
    outside = np.tile((12.5, 0.3, 0.0), (len(bend()), 1))
    log = scene(bend(), outside)
    leader = oracle(log).leader(0, world(log))
    assert leader == pytest.approx((10 - 2, 0), abs=ROUNDING)


def test_a_chord_that_comes_back_to_its_start_is_passed_over() -> None:
    # 2.5 m east and back in chord 0, then on backwards: the front at x = -18 is 3 m
    # into chord 4, which starts after 20 m.
    there_and_back = np.array([(2.5 - abs(2.5 - 0.5 * t), 0, 0) for t in range(11)])
    log = scene(there_and_back, eastward(-20, 0, 0))
    leader = oracle(log).leader(0, world(log))
    assert leader == pytest.approx((23 - 2, 0), abs=ROUNDING)


def test_a_car_across_the_path_is_met_with_its_nearest_corner() -> None:
    # Turned by 45 degrees at x = 21: its nearest corner is 3 / sqrt 2 nearer.
    crossing = np.tile((21.0, 0.0, math.pi / 4), (11, 1))
    log = scene(eastward(0, 0, 10), crossing)
    leader = oracle(log).leader(0, world(log))
    assert leader == pytest.approx((21 - 3 / 2**0.5 - 2, 0), abs=ROUNDING)


def test_poses_between_the_logged_ones_turn_the_short_way() -> None:
    path = idm.Path(
        np.array([(0, 0), (-2, 0), (-2, 0), (-2, 1.0)]), np.array([3.1, -3.1, 3, 3])
    )
    xy, yaw = path.pose(1.0)
    np.testing.assert_allclose(xy, (-1, 0), atol=ROUNDING)
    assert abs(yaw) == pytest.approx(math.pi, abs=ROUNDING)
    _, after_standing = path.pose(2.0)
    assert after_standing == 3
    beyond, last_yaw = path.pose(5.0)
    expected = (-2 + 2 * math.cos(3), 1 + 2 * math.sin(3))
    np.testing.assert_allclose(beyond, expected, atol=ROUNDING)
    assert last_yaw == 3


def test_only_free_moving_vehicles_are_driven() -> None:
    log = scene(
        eastward(0, 0, 10),
        eastward(0, 10, 0.9),  # gets 0.9 m away
        eastward(0, 20, 10),  # a pedestrian
        eastward(0, 30, 10),  # absent at the current step
        eastward(0, 40, 10),  # overlaps the next
        eastward(3, 40, 10),
        eastward(0, 50, 10),  # overlaps one that is absent
        eastward(3, 50, 10),
    )
    log.object_type[2] = PEDESTRIAN
    log.valid[[3, 7], 0] = False
    assert np.flatnonzero(oracle(log).driven).tolist() == [0, 6]


def test_a_parked_car_that_only_trembles_is_not_driven() -> None:
    # 0.4 m to and fro ten times: 4 m of path, never more than 0.4 m away.
    trembling = np.array([(0.4 * (t % 2), 0, 0) for t in range(11)])
    there_and_back = np.array([(1.5 - abs(1.5 - 0.3 * t), 9, 0) for t in range(11)])
    assert oracle(scene(trembling, there_and_back)).driven.tolist() == [False, True]


def test_what_is_not_logged_as_valid_is_not_on_the_path() -> None:
    log = scene(eastward(0, 0, 15))
    log.xyz[0, 3:6], log.yaw[0, 3:6], log.valid[0, 3:6] = 1e4, 9, False
    targets = oracle(log).step(world(log))
    np.testing.assert_allclose(targets.xy, [(1.509375, 0)], atol=ROUNDING)
    np.testing.assert_allclose(oracle(log).paths[0].arc[-1], 15, atol=ROUNDING)


def test_the_path_begins_at_the_current_step() -> None:
    log = scene(eastward(0, 0, 15))
    agents = idm.IdmOracle(log, 4, idm.Params())
    target = agents.step(world(log, 4))
    np.testing.assert_allclose(target.xy, [(7.509375, 0)], atol=ROUNDING)


def test_a_car_that_reverses_moves_against_its_heading() -> None:
    # From 1 m/s with 2 (1 - 1 / 30^4) m/s^2; past its end, 1 m behind, likewise.
    log = scene(eastward(0, 0, -1))
    agents = oracle(log)
    speed = 1 + 0.2 * (1 - 30**-4)
    target = agents.step(world(log))
    np.testing.assert_allclose(target.xy, [(-(1 + speed) / 20, 0)], atol=ROUNDING)
    np.testing.assert_allclose(target.velocity, [(-speed, 0)], atol=ROUNDING)
    place, _ = agents.paths[0].pose(3.0)
    np.testing.assert_allclose(place, (-3, 0), atol=ROUNDING)


@pytest.mark.parametrize(
    ("light", "gap"),
    [
        (idm.Light(np.array([22.0, 1.0]), 0.0, True), 20),
        (idm.Light(np.array([22.0, 1.0]), 0.0, False), None),
        (idm.Light(np.array([22.0, 2.1]), 0.0, True), None),
        (idm.Light(np.array([22.0, 1.0]), 0.8, True), None),
        (idm.Light(np.array([1.9, 0.0]), 0.0, True), None),
        # 10^2 / (2 * 8.3) m/s^2 is more than 6.
        (idm.Light(np.array([10.3, 0.0]), 0.0, True), None),
    ],
)
def test_a_red_light_is_a_leader_at_rest(light: idm.Light, gap: float | None) -> None:
    log = scene(eastward(0, 0, 10))
    leader = oracle(log).red_light(0, [light])
    assert leader == (None if gap is None else pytest.approx((gap, 0), abs=ROUNDING))
    target = oracle(log).step(world(log), [light])
    ahead = None if gap is None else idm.Leader(gap, 0)
    expected = 10 + 0.1 * idm.acceleration(10, ahead, idm.Params())
    np.testing.assert_allclose(target.velocity, [(expected, 0)], atol=ROUNDING)
