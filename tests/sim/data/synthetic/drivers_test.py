"""Tests of the car-following of generated drivers, against hand numbers."""

import numpy as np
import pytest

from drivetrain.sim.data.synthetic import drivers as experts
from drivetrain.sim.data.synthetic.drivers import Drivers


@pytest.fixture
def driver() -> Drivers:
    one = np.ones(1)
    return Drivers(
        size=np.array([[4.5, 2.0, 1.5]]),
        is_cyclist=np.zeros(1, bool),
        desired=one,
        top_speed=40.0 * one,
        headway=1.5 * one,
        acceleration=2.0 * one,
        braking=2.0 * one,
        standstill=2.0 * one,
        aside=2.0 * one,
        reaction=0.3 * one,
        courtesy=0.2 * one,
    )


def test_idm_accelerates_fully_from_rest(driver: Drivers) -> None:
    assert experts.free(driver, np.zeros(1), np.array([10.0])) == [2.0]


def test_idm_on_a_free_road_fades_with_the_fourth_power(driver: Drivers) -> None:
    # 2 (1 - (5 / 10)^4) = 1.875
    assert experts.free(driver, np.array([5.0]), np.array([10.0])) == [1.875]


def test_who_is_far_too_fast_brakes_by_b(driver: Drivers) -> None:
    assert experts.free(driver, np.array([20.0]), np.array([10.0])) == [-2.0]


def test_the_interaction_is_that_of_treiber_2000(driver: Drivers) -> None:
    # s* = 2 + 10 1.5 + 10 4 / (2 sqrt(2 2)) = 27, and 2 (27 / 54)^2 = 0.5
    push = experts.interaction(
        driver, np.array([10.0]), np.array([54.0]), np.array([4.0])
    )
    assert push == [0.5]


def test_a_leader_that_flees_leaves_the_standstill_gap(driver: Drivers) -> None:
    # s* is at least s0: 2 (2 / 8)^2 = 0.125
    push = experts.interaction(
        driver, np.array([10.0]), np.array([8.0]), np.array([-30.0])
    )
    assert push == [0.125]


def test_a_line_far_away_is_hardly_felt(driver: Drivers) -> None:
    near, far = (
        experts.halt(driver, np.array([10.0]), np.array([distance]))[0]
        for distance in (30.0, 300.0)
    )
    assert near == pytest.approx(100 * far)


def test_sizes_are_those_of_cars_and_bicycles() -> None:
    is_cyclist = np.arange(400) < 100
    drawn = experts.draw(np.random.default_rng(0), is_cyclist)
    bicycle, car = drawn.size[:100], drawn.size[100:]
    assert bicycle[:, 0].max() < 2.0 and bicycle[:, 1].max() < 1.0
    assert car[:, 0].min() > 4.0 and car[:, 0].max() < 12.0
    assert 4.5 < np.median(car[:, 0]) < 5.0 and 1.9 < np.median(car[:, 1]) < 2.2
    assert drawn.top_speed[:100].max() < 7.0
