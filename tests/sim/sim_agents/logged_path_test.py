"""Tests logged ways against the path of the oracle."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.scenario import Scenario
from drivetrain.sim.sim_agents import logged_path
from tests import worlds
from tests.oracles.idm import Path

# Sums of 80 distances, each rounded in float32 at up to 500 m.
ROUNDING = 2e-3  # metres
# A turn between two poses that may lie millimetres apart, at a place rounded.
TURN_ROUNDING = 0.02  # radians
gather = jax.jit(logged_path.logged_path)


def oracle_of(scenario: Scenario, track: int) -> Path:
    """Returns the way of one track from the current step on."""
    tracks, now = scenario.tracks, scenario.current_step
    steps = now + np.flatnonzero(tracks.valid[track, now:])
    xy = (tracks.xyz[track, steps] - scenario.origin)[:, :2]
    return Path(xy, tracks.yaw[track, steps])


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_places_on_the_way_are_those_of_the_oracle(kind: str) -> None:
    rng = np.random.default_rng(0)
    for index, scenario in enumerate(worlds.scenarios(kind)):
        path = gather(worlds.scene(worlds.bank(kind), index))
        share = rng.uniform(0, 1.5, (len(path.is_driven), 20))  # past the end as well
        stations = np.float32(share * np.asarray(path.arc)[:, -1:])
        xy, yaw = path.at(jnp.asarray(stations))
        for slot, track in enumerate(worlds.order_of(scenario, worlds.MAX_OBJECTS)):
            if not path.is_driven[slot]:
                continue
            oracle = oracle_of(scenario, int(track))
            assert abs(path.arc[slot, -1] - oracle.arc[-1]) < ROUNDING
            expected = [oracle.pose(float(s)) for s in stations[slot]]
            np.testing.assert_allclose(
                xy[slot], [place for place, _ in expected], rtol=0, atol=ROUNDING
            )
            turn = np.asarray(yaw)[slot] - [turned for _, turned in expected]
            wrapped = (turn + np.pi) % (2 * np.pi) - np.pi
            np.testing.assert_allclose(wrapped, 0, atol=TURN_ROUNDING)


def with_log(kind: str, xy: np.ndarray, valid: np.ndarray) -> Scenario:
    """Returns a scenario whose second track goes where it is told to."""
    scenario = worlds.scenarios(kind)[0]
    tracks = scenario.tracks
    xyz, here = tracks.xyz.copy(), tracks.valid.copy()
    now = scenario.current_step
    xyz[1, :, :2] = xyz[0, now, :2] + 2.0
    xyz[1, now : now + len(xy), :2] += xy
    here[1] = False
    here[1, now : now + len(xy)] = valid
    return dataclasses.replace(
        scenario, tracks=dataclasses.replace(tracks, xyz=xyz, valid=here)
    )


def is_driven(scenario: Scenario) -> bool:
    """Tells whether the second track is driven."""
    bank = worlds.bank_of([worlds.exact(scenario)])
    order = worlds.order_of(scenario, worlds.MAX_OBJECTS)
    slot = int(np.flatnonzero(order == 1)[0])
    return bool(gather(worlds.scene(bank, 0)).is_driven[slot])


@pytest.mark.parametrize(
    ("reach", "driven"), [((0.0, 0.99), False), ((0.0, 1.01), True), ((1.5, 0.0), True)]
)
def test_only_what_gets_a_metre_away_is_driven(
    reach: tuple[float, float], driven: bool
) -> None:
    xy = np.zeros((3, 2))
    xy[1:, 0] = reach
    scenario = with_log("generated", xy, np.ones(3, bool))
    assert is_driven(scenario) is driven


def test_trembling_is_not_driving() -> None:
    xy = np.zeros((40, 2))
    xy[1::2] = 0.3
    assert not is_driven(with_log("generated", xy, np.ones(40, bool)))


def test_who_is_absent_at_the_current_step_is_not_driven() -> None:
    xy = np.arange(20)[:, None] * np.ones(2)
    valid = np.arange(20) > 0
    assert not is_driven(with_log("generated", xy, valid))


def test_gaps_of_the_log_are_bridged() -> None:
    xy = np.arange(20)[:, None] * np.array([3.0, 4.0])
    valid = np.isin(np.arange(20), (0, 1, 7, 19))
    scenario = with_log("generated", np.where(valid[:, None], xy, 1e3), valid)
    bank = worlds.bank_of([worlds.exact(scenario)])
    order = worlds.order_of(scenario, worlds.MAX_OBJECTS)
    slot = int(np.flatnonzero(order == 1)[0])
    path = gather(worlds.scene(bank, 0))
    assert float(path.arc[slot, -1]) == pytest.approx(95.0, abs=ROUNDING)
    start = scenario.tracks.xyz[1, scenario.current_step] - scenario.origin
    stations = jnp.zeros((len(path.is_driven), 1)).at[slot].set(50.0)
    place = np.asarray(path.at(stations)[0])[slot, 0]
    np.testing.assert_allclose(place - start[:2], (30, 40), rtol=0, atol=ROUNDING)


def test_the_height_is_the_log_s_at_that_step() -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    follower = logged_path.follow(scene)
    logged = worlds.log_at(scene, scene.current_step + 1)
    still = jnp.zeros(len(logged.yaw))
    _, moved = logged_path.advance(scene, follower, still, logged)
    here = np.asarray(logged.valid)
    np.testing.assert_array_equal(moved.xyz[here, 2], logged.xyz[here, 2])


def test_full_braking_ends_in_a_stop() -> None:
    scene = worlds.scene(worlds.bank("generated"), 0)
    follower = logged_path.follow(scene)
    logged = worlds.log_at(scene, scene.current_step + 1)
    braking = jnp.full(len(logged.yaw), -1e3)
    after, moved = logged_path.advance(scene, follower, braking, logged)
    np.testing.assert_array_equal(after.speed, 0)
    np.testing.assert_allclose(after.arc, follower.speed * 0.05, rtol=1e-5)
    driven = np.asarray(after.is_driven)
    np.testing.assert_array_equal(np.asarray(moved.velocity)[driven], 0)


def test_a_car_that_reverses_goes_on_backwards() -> None:
    scenario = worlds.scenarios("generated")[0]
    tracks, now, yaw = scenario.tracks, scenario.current_step, 0.7
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    xyz, yaws, velocity = tracks.xyz.copy(), tracks.yaw.copy(), tracks.velocity.copy()
    valid = tracks.valid.copy()
    steps = np.arange(20)  # 0.4 m each, backwards: 7.6 m
    xyz[1, now : now + 20, :2] = xyz[0, now, :2] - 0.4 * steps[:, None] * ahead
    yaws[1], velocity[1] = yaw, -4.0 * ahead
    valid[1] = np.isin(np.arange(scenario.num_steps), now + steps)
    tracks = dataclasses.replace(
        tracks, xyz=xyz, yaw=yaws, velocity=velocity, valid=valid
    )
    scenario = dataclasses.replace(scenario, tracks=tracks)
    bank = worlds.bank_of([worlds.exact(scenario)])
    slot = int(np.flatnonzero(worlds.order_of(scenario, worlds.MAX_OBJECTS) == 1)[0])
    scene = worlds.scene(bank, 0)
    follower = jax.jit(logged_path.follow)(scene)
    advance = jax.jit(logged_path.advance)
    still = jnp.zeros(len(follower.arc))
    for step in range(1, 31):  # the log of the car ends after 19
        logged = worlds.log_at(scene, jnp.int32(now + step))
        follower, moved = advance(scene, follower, still, logged)
        start = (xyz[1, now] - scenario.origin)[:2]
        expected = start - 0.4 * step * ahead
        np.testing.assert_allclose(moved.xy[slot], expected, atol=ROUNDING)
        np.testing.assert_allclose(moved.velocity[slot], -4.0 * ahead, rtol=1e-5)
