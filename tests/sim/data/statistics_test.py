"""Tests that figures of traffic are those of hand-made scenes."""

import dataclasses

import numpy as np
import pytest

from drivetrain.sim.data import light_check, statistics
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.data.planar_log import planar_log
from drivetrain.sim.scenario import Lights, LightState, MapType, Polylines, Scenario
from tests.sim.data import files

NUM_STEPS = 41
QUANTA = 0.02  # metres, and metres per second: two of the bank's


def scene(
    x: np.ndarray, y: float, speed: np.ndarray, light: LightState | None = None
) -> Packed:
    """Returns vehicles that drive along +x, with a light at the origin.

    Args:
        x: of each vehicle at step 0 [m].
        y: of all [m].
        speed: of each, constant [m/s].
        light: what the light shows throughout.
    """
    source = files.scenario(0, NUM_STEPS)
    time = 0.1 * np.arange(NUM_STEPS)
    place = x[:, None] + speed[:, None] * time
    xyz = np.stack([place, np.full_like(place, y), np.zeros_like(place)], axis=-1)
    ones = np.ones_like(place)
    tracks = dataclasses.replace(
        source.tracks,
        object_id=np.arange(len(x)),
        object_type=np.ones(len(x), int),
        xyz=xyz,
        yaw=0 * ones,
        velocity=np.stack([speed[:, None] * ones, 0 * ones], axis=-1),
        valid=ones > 0,
        size=np.tile([4.0, 2.0, 1.5], (len(x), 1)),
        is_of_interest=np.zeros(len(x), bool),
    )
    lane = np.array([(-50.0, 0, 0), (50, 0, 0)])
    shown = [light] if light is not None else []
    made = Scenario(
        scenario_id="hand",
        dataset="hand",
        tracks=tracks,
        ego_index=0,
        ego_source="marked",
        roads=Polylines(
            xyz=np.concatenate([lane, lane - [0, 8, 0]]),
            offset=np.array([0, 2, 4]),
            map_type=np.array([MapType.LANE_SURFACE_STREET, MapType.EDGE_BOUNDARY]),
            feature_id=np.array([1, 2]),
        ),
        lights=Lights(
            lane_id=np.ones(len(shown), int),
            xyz=np.zeros((len(shown), 3)),
            state=np.full((len(shown), NUM_STEPS), [int(s) for s in shown] or 0),
            valid=np.ones((len(shown), NUM_STEPS), bool),
        ),
        lane_links=None,
    )
    return pack(made, PackConfig())


def test_the_log_reads_back_in_the_frame_of_the_scenario() -> None:
    source = files.scenario(4)
    packed = pack(source, PackConfig())
    log = planar_log(packed)
    for row, name in enumerate(packed.object_id):
        place = int(np.flatnonzero(source.tracks.object_id == name)[0])
        valid = source.tracks.valid[place]
        assert (log.valid[row] == valid).all()
        wanted = (source.tracks.xyz[place] - source.origin)[valid, :2]
        np.testing.assert_allclose(log.xy[row, valid], wanted, atol=QUANTA)
        velocity = source.tracks.velocity[place, valid]
        np.testing.assert_allclose(log.velocity[row, valid], velocity, atol=QUANTA)


def test_headway_is_the_gap_over_the_speed() -> None:
    # 24 m from centre to centre are 20 m between bumpers; the gap stays.
    found = statistics.samples([scene(np.array([0.0, 24.0]), 0.0, np.full(2, 10.0))])
    np.testing.assert_allclose(found["headway"], 2.0, atol=0.01)
    assert len(found["headway"]) == 5  # the one behind, at five whole seconds


def test_nobody_is_followed_beside_the_line() -> None:
    one = scene(np.array([0.0]), 0.0, np.array([10.0]))
    assert len(statistics.samples([one])["headway"]) == 0


def test_speeds_and_accelerations_are_those_of_the_log() -> None:
    found = statistics.samples(
        [scene(np.array([0.0, 50.0]), 0.0, np.array([7.0, 3.0]))]
    )
    np.testing.assert_allclose(np.unique(found["speed"].round(1)), [3.0, 7.0])
    np.testing.assert_allclose(found["ego_speed"], 7.0, atol=QUANTA)
    np.testing.assert_allclose(found["acceleration"], 0.0, atol=2 * QUANTA / 0.5)
    assert found["objects"].tolist() == [2] and found["standing"].tolist() == [0]


@pytest.mark.parametrize(
    ("one", "other", "wanted"),
    [
        ([1, 2, 3, 4], [1, 2, 3, 4], 0.0),
        ([0, 0, 0, 1], [0, 1, 1, 1], 0.5),
        ([1, 2], [3, 4], 1.0),
        ([1, 3], [2, 4], 0.5),
    ],
)
def test_the_distance_is_that_of_kolmogorov_and_smirnov(one, other, wanted) -> None:
    a, b = np.array(one, float), np.array(other, float)
    assert statistics.distance(a, b) == wanted == statistics.distance(b, a)


def test_no_samples_have_no_distance() -> None:
    assert np.isnan(statistics.distance(np.zeros(0), np.ones(3)))


@pytest.mark.parametrize(
    ("light", "y", "speed", "wanted"),
    [
        (LightState.STOP, 0.0, 10.0, (2, 0)),
        (LightState.ARROW_STOP, 1.9, 10.0, (2, 0)),
        (LightState.GO, 0.0, 10.0, (0, 2)),
        (LightState.CAUTION, 0.0, 10.0, (0, 0)),
        (LightState.STOP, 2.1, 10.0, (0, 0)),
        (LightState.STOP, 0.0, 1.0, (0, 0)),
        (None, 0.0, 10.0, (0, 0)),
    ],
)
def test_who_passes_a_light_is_counted_by_what_it_shows(
    light, y, speed, wanted
) -> None:
    # Of three vehicles two come to the light in four seconds at 10 m/s, none at 1 m/s.
    packed = scene(np.array([-20.0, -30.0, 5.0]), y, np.full(3, speed), light)
    assert light_check.crossings(packed, planar_log(packed)) == wanted
