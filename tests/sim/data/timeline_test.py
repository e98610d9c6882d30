"""Tests that logs of any rate come to steps of 0.1 s."""

import dataclasses
import pathlib

import numpy as np
import pytest

from drivetrain.sim.data import build, timeline
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.data.timeline import Timeline
from drivetrain.sim.scenario import Scenario, ScenarioError
from tests.sim.data import files, protos

ROUNDING = 1e-9  # float64, places of 100 m
# A chord of 5 m on a circle of 20 m, between whose ends a cubic curve with the slopes
# of its neighbours' chords strays from the circle: the slopes are short by the share
# 1 - sin(a)/a = 1 % of 5 m, of which an eighth shows in the middle at either end.
STRAY = 2 * 0.0104 * 5 / 8


def moving(dt: float, num_steps: int, radius: float = 20.0) -> Scenario:
    """Returns a scenario whose objects circle at 10 m/s, each from its own place."""
    source = files.scenario(0, num_steps)
    start = np.arange(len(source.tracks.object_id))[:, None]
    angle = start + 10.0 / radius * dt * np.arange(num_steps)
    direction = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    xy = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    tracks = dataclasses.replace(
        source.tracks,
        xyz=np.concatenate([xy, np.zeros((*angle.shape, 1))], axis=-1),
        yaw=(angle + np.pi / 2 + np.pi) % (2 * np.pi) - np.pi,
        velocity=10.0 * direction,
        valid=np.ones(angle.shape, bool),
    )
    return dataclasses.replace(source, dt=dt, tracks=tracks, current_step=2)


@pytest.mark.parametrize(("dt", "num_steps"), [(0.5, 9), (0.04, 101), (0.2, 21)])
def test_a_circle_stays_one(dt: float, num_steps: int) -> None:
    wanted = moving(0.1, round((num_steps - 1) * dt / 0.1) + 1).tracks
    found = timeline.aligned(moving(dt, num_steps), timeline.DEFAULT)
    assert found.dt == 0.1 and found.num_steps == wanted.valid.shape[1]
    inside = slice(round(dt / 0.1) + 1, -round(dt / 0.1) - 1)  # ends have one neighbour
    miss = np.linalg.norm(found.tracks.xyz - wanted.xyz, axis=-1)[:, inside]
    assert miss.max() < STRAY
    turn = np.angle(np.exp(1j * (found.tracks.yaw - wanted.yaw)))
    assert np.abs(turn).max() < ROUNDING
    assert found.tracks.valid.all()


def test_velocities_are_those_of_the_curve() -> None:
    tracks = timeline.aligned(moving(0.5, 9), timeline.DEFAULT).tracks
    central = (tracks.xyz[:, 2:] - tracks.xyz[:, :-2])[..., :2] / 0.2
    between = np.arange(1, central.shape[1] + 1) % 5 != 0  # logged steps keep theirs
    # Over 0.2 s a cubic's chord differs from its slope by a sixth of its third
    # derivative, here at most 10 / s^2 x 0.1^2 s^2 of 10 m/s.
    error = np.abs(central - tracks.velocity[:, 1:-1])[:, between]
    assert error.max() < 0.1


def test_logged_steps_stay_as_they_are() -> None:
    source = dataclasses.replace(files.scenario(3), dt=0.3)
    found = timeline.aligned(source, timeline.DEFAULT)
    for name in ("xyz", "yaw", "velocity", "valid"):
        kept = getattr(found.tracks, name)[:, ::3]
        np.testing.assert_allclose(
            kept, getattr(source.tracks, name), rtol=0, atol=ROUNDING
        )
    np.testing.assert_array_equal(found.lights.state[:, ::3], source.lights.state)
    assert found.current_step == 3 * source.current_step


def test_a_light_shows_what_it_showed_at_the_logged_step_before() -> None:
    source = dataclasses.replace(files.scenario(3), dt=0.3)
    state, valid = source.lights.state, source.lights.valid
    assert (state[:, 1:] != state[:, :-1]).any()
    assert (valid[:, 1:] != valid[:, :-1]).any()
    found = timeline.aligned(source, timeline.DEFAULT).lights
    for between in (1, 2):
        np.testing.assert_array_equal(found.state[:, between::3], state[:, :-1])
        np.testing.assert_array_equal(found.valid[:, between::3], valid[:, :-1])


def test_a_step_between_is_valid_if_both_around_it_are() -> None:
    source = dataclasses.replace(files.scenario(3), dt=0.2)
    valid = source.tracks.valid
    found = timeline.aligned(source, timeline.DEFAULT).tracks
    np.testing.assert_array_equal(found.valid[:, 1::2], valid[:, 1:] & valid[:, :-1])
    assert not found.xyz[~found.valid].any()


def test_what_is_not_valid_moves_nothing() -> None:
    source = dataclasses.replace(files.scenario(3), dt=0.2)
    junk = np.where(source.tracks.valid[..., None], source.tracks.xyz, 1e4)
    tracks = dataclasses.replace(source.tracks, xyz=junk)
    found = timeline.aligned(source, timeline.DEFAULT)
    other = timeline.aligned(
        dataclasses.replace(source, tracks=tracks), timeline.DEFAULT
    )
    assert files.differences(other, found) == []


def test_the_rate_of_the_simulator_changes_nothing() -> None:
    source = files.scenario(3)
    assert timeline.aligned(source, timeline.DEFAULT).tracks is source.tracks


def test_other_rates_are_refused_if_wanted() -> None:
    with pytest.raises(ScenarioError, match=r"the steps take 0.5 s; only steps of 0.1"):
        timeline.aligned(moving(0.5, 9), Timeline(other_rates="refuse"))


def test_a_log_of_hours_is_refused() -> None:
    with pytest.raises(ScenarioError, match="the log takes 90000 s, at most 1000 s"):
        timeline.aligned(moving(1e4, 10), timeline.DEFAULT)


def test_an_earlier_current_step_lets_short_logs_be_used(tmp_path: pathlib.Path):
    path = tmp_path / "log"
    short = files.without_future(files.scenario())
    path.write_bytes(files.tfrecord(protos.scenario_proto(short)))
    (bad,) = build.read(path)
    assert isinstance(bad, BadRecord) and "--timeline.current-step" in bad.reason
    (found,) = build.read(path, Timeline(current_step=4))
    assert isinstance(found, Scenario) and found.current_step == 4


def test_a_negative_step_is_refused() -> None:
    with pytest.raises(ValueError, match="current_step must be at least 0, got -1"):
        Timeline(current_step=-1)


@pytest.mark.parametrize(
    ("limit", "sentence"),
    [
        ("MAX_STATES", "there are 455 states of objects in steps of 0.1 s"),
        ("MAX_LIGHT_STEPS", "there are 182 states of lights in steps of 0.1 s"),
    ],
)
def test_too_many_new_states_are_named(
    monkeypatch: pytest.MonkeyPatch, limit: str, sentence: str
) -> None:
    # Ten steps of 1 s become 91 of 0.1 s, of five objects and two lights.
    monkeypatch.setattr(timeline.parts, limit, 9 * 10)
    with pytest.raises(ScenarioError, match=sentence):
        timeline.aligned(moving(1.0, 10), timeline.DEFAULT)
