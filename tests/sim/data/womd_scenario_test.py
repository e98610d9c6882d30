"""Tests of the reader of Scenario protos."""

import dataclasses

import numpy as np
import pytest

from drivetrain.sim import scenario
from drivetrain.sim.data import womd_scenario
from drivetrain.sim.scenario import LightState, MapType, Scenario, ScenarioError
from tests.sim.data import files, protos

REAL_FILE = files.REAL_DATA / "womd/motion_data_one_scenario.tfrecord"
MEDIAN_STEP_ERROR = 0.01  # metres: the log is smoothed, so |dx - v dt| is millimetres


def written(seed: int = 0) -> Scenario:
    """Returns a scenario as the reader should name it."""
    return dataclasses.replace(files.scenario(seed), dataset="womd_scenario")


@pytest.mark.parametrize("seed", range(3))
def test_a_scenario_comes_back(seed: int) -> None:
    wanted = written(seed)
    found = womd_scenario.convert(protos.scenario_proto(wanted))
    assert files.differences(found, wanted) == []


def test_lists_need_not_be_packed() -> None:
    wanted = written()
    found = womd_scenario.convert(protos.scenario_proto(wanted, is_packed=False))
    assert files.differences(found, wanted) == []


def test_unknown_fields_change_nothing() -> None:
    data = protos.scenario_proto(written(), state_tail=protos.field(15, 7))
    assert files.differences(womd_scenario.convert(data), written()) == []


def test_a_second_value_of_a_field_replaces_the_first() -> None:
    data = protos.scenario_proto(written()) + protos.field(5, b"other")
    assert womd_scenario.convert(data).scenario_id == "other"


def test_without_a_mark_the_last_car_is_the_ego() -> None:
    data = protos.scenario_proto(written()) + protos.field(6, -1)
    found = womd_scenario.convert(data)
    assert (found.ego_index, found.ego_source) == (4, "last")


def test_unknown_types_are_kept_as_unknown() -> None:
    edge = protos.field(1, 77) + protos.field(2, protos.map_point(np.ones(3)))
    feature = protos.field(1, 500) + protos.field(5, edge)
    data = protos.scenario_proto(written()) + protos.field(8, feature)
    found = womd_scenario.convert(data).roads
    assert found.map_type[found.feature_id == 500].tolist() == [MapType.EDGE_UNKNOWN]


def test_a_light_without_a_place_is_not_valid() -> None:
    wanted = written()
    light = protos.field(1, 99) + protos.field(2, int(LightState.STOP))
    step = protos.field(7, protos.field(1, light))
    dark = dataclasses.replace(wanted.lights, valid=np.zeros_like(wanted.lights.valid))
    data = protos.scenario_proto(dataclasses.replace(wanted, lights=dark))
    lights = womd_scenario.convert(data.replace(protos.field(7, b""), step, 1)).lights
    assert lights.lane_id.tolist() == [99]
    assert not lights.valid.any()
    assert not lights.state.any()


@pytest.mark.parametrize(
    ("extra", "sentence"),
    [
        (protos.field(10, -1), "current_time_index must be at least 0, got -1"),
        (protos.field(2, protos.field(1, 7)), "the tracks have 0 to 30 steps"),
        (protos.field(6, 99), "the ego is marked as track 99"),
        (protos.field(11, protos.field(1, 99)), "tracks_to_predict names track 99"),
        (b"\xff", "bytes are no Scenario message"),
    ],
)
def test_contradictions_are_named(extra: bytes, sentence: str) -> None:
    with pytest.raises(ScenarioError, match=sentence):
        womd_scenario.convert(protos.scenario_proto(written()) + extra)


def test_a_light_after_the_last_step_is_named() -> None:
    light = protos.field(1, 99) + protos.field(3, protos.map_point(np.ones(3)))
    data = protos.scenario_proto(written()) + protos.field(7, protos.field(1, light))
    with pytest.raises(ScenarioError, match="a traffic light is told for step 30 of"):
        womd_scenario.convert(data)


@pytest.mark.skipif(not REAL_FILE.exists(), reason=files.NO_REAL_DATA)
def test_the_official_sample_holds_what_is_known_of_it() -> None:
    (found,) = womd_scenario.READER.records(REAL_FILE)
    assert isinstance(found, Scenario)
    assert found.scenario_id == "637f20cafde22ff8"
    assert found.tracks.valid.shape == (83, 91)
    assert found.tracks.valid.sum() == 4596
    assert found.roads.num_features == 301
    assert found.lane_links is not None
    lanes = np.isin(found.roads.map_type, scenario.LANES)
    exits = np.isin(found.roads.feature_id, found.lane_links.successor[:, 0]) & lanes
    assert (lanes.sum(), exits.sum()) in ((199, 167), (114, 104))
    assert set(found.lights.lane_id) <= set(found.roads.feature_id[lanes])


@pytest.mark.skipif(not REAL_FILE.exists(), reason=files.NO_REAL_DATA)
def test_velocities_of_the_official_sample_are_those_of_its_positions() -> None:
    (found,) = womd_scenario.READER.records(REAL_FILE)
    assert isinstance(found, Scenario)
    tracks = found.tracks
    both = tracks.valid[:, 1:] & tracks.valid[:, :-1]
    error = np.diff(tracks.xyz[..., :2], axis=1) - tracks.velocity[:, 1:] * found.dt
    assert np.median(np.linalg.norm(error[both], axis=-1)) < MEDIAN_STEP_ERROR


@pytest.mark.parametrize(
    ("tail", "sentence"),
    [
        (protos.field(2, b"") * 100_001, "there are 100006 tracks"),
        (
            protos.field(2, protos.field(3, b"") * (1 << 20)),
            "1048726 states of objects",
        ),
        (
            protos.field(8, protos.field(3, protos.field(8, b"") * (1 << 21))),
            "there are 20972.. points of the map",
        ),
    ],
    ids=["tracks", "states", "points"],
)
def test_more_than_a_scenario_has_is_refused(tail: bytes, sentence: str) -> None:
    proto = protos.scenario_proto(written()) + tail
    with pytest.raises(ScenarioError, match=sentence):
        womd_scenario.convert(proto)
