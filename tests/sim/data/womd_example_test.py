"""Tests of the reader of tf.Examples."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from drivetrain.sim import scenario
from drivetrain.sim.data import womd_example
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import Scenario, ScenarioError
from tests.sim.data import files, protos

REAL_FILE = files.REAL_DATA / "womd/motion_data_one_example.tfrecord"
MEDIAN_STEP_ERROR = 0.01  # metres: the log is smoothed, so |dx - v dt| is millimetres


def written(seed: int = 0) -> Scenario:
    """Returns a scenario as the reader should name it."""
    return dataclasses.replace(
        files.scenario(seed),
        dataset="womd_example",
        lane_links=None,
        assumptions=("lane links from lane ends, no speed limits",),
    )


def changed(**features: Any) -> bytes:
    """Encodes a tf.Example with other features; None leaves one out."""
    named = {name.replace("__", "/"): values for name, values in features.items()}
    merged = protos.example_features(written()) | named
    kept = {name: values for name, values in merged.items() if values is not None}
    return protos.example_proto(written().scenario_id, kept)


@pytest.mark.parametrize("seed", range(3))
def test_a_scenario_comes_back(seed: int) -> None:
    wanted = written(seed)
    data = protos.example_proto(wanted.scenario_id, protos.example_features(wanted))
    assert files.differences(womd_example.convert(data), wanted) == []


def test_lists_need_not_be_packed() -> None:
    wanted = written()
    features = protos.example_features(wanted)
    data = protos.example_proto(wanted.scenario_id, features, is_packed=False)
    assert files.differences(womd_example.convert(data), wanted) == []


def test_padding_changes_nothing() -> None:
    wanted = written()
    for num_padding in (0, 40):
        features = protos.example_features(wanted, num_padding)
        found = womd_example.convert(protos.example_proto("id", features))
        assert files.differences(found.tracks, wanted.tracks) == []
        assert files.differences(found.roads, wanted.roads) == []


def test_the_ego_keeps_its_mark_when_padding_stands_before_it() -> None:
    features = protos.example_features(written())
    rolled = {
        name: np.roll(values, 1, axis=0) if name.startswith("state/") else values
        for name, values in features.items()
    }
    found = womd_example.convert(protos.example_proto("id", rolled))
    assert (found.ego_index, found.ego_source) == (4, "marked")


def with_paths(xyz: np.ndarray, valid: np.ndarray) -> bytes:
    """Encodes a tf.Example with three paths, of which the last leaves the route."""
    return changed(
        path_samples__xyz=xyz.astype(np.float32),
        path_samples__valid=valid.astype(np.int64),
        path_samples__id=np.zeros(valid.shape, np.int64),
        path_samples__on_route=np.array([[1], [1], [0]]),
    )


PATHS = np.arange(36.0).reshape(3, 4, 3)


def test_paths_are_read_where_there_are_some() -> None:
    valid = np.array([[1, 1, 1, 0], [0, 0, 0, 0], [1, 1, 0, 0]])
    paths = womd_example.convert(with_paths(PATHS, valid)).paths
    assert paths is not None
    assert np.array_equal(paths.points_of(0), PATHS[0, :3])
    assert np.array_equal(paths.points_of(1), PATHS[2, :2])
    assert paths.on_route.tolist() == [True, False]
    assert paths.source == "path_samples"


def test_paths_of_padding_alone_are_none() -> None:
    data = with_paths(PATHS, np.zeros((3, 4)))
    assert womd_example.convert(data).paths is None


def test_a_path_that_is_not_finite_is_an_error() -> None:
    with pytest.raises(ScenarioError, match="xyz' has a value that is not finite"):
        womd_example.convert(with_paths(PATHS + np.inf, np.ones((3, 4))))


def test_lights_may_be_absent() -> None:
    features = {
        name: values
        for name, values in protos.example_features(written()).items()
        if not name.startswith("traffic_light_state")
    }
    found = womd_example.convert(protos.example_proto("id", features))
    assert found.lights.valid.shape == (0, 30)


def test_a_testing_split_is_too_short() -> None:
    features = {
        name: values
        for name, values in protos.example_features(written()).items()
        if "/future/" not in name
    }
    found = womd_example.convert(protos.example_proto("id", features))
    with pytest.raises(ScenarioError, match="too short: 11 steps"):
        scenario.check(found)


@pytest.mark.parametrize(
    ("features", "sentence"),
    [
        ({"state__id": None}, "feature 'state/id' is missing"),
        ({"state__future__x": None}, "feature 'state/future/x' is missing"),
        ({"state__past__y": np.zeros(7)}, "'state/past/y' has 7 values"),
        ({"state__past__y": np.zeros(8)}, "have 21 steps and 'state/.*/valid' have 30"),
        (
            {"state__id": np.full(8, np.nan)},
            "'state/id' has a value that is no int",
        ),
        ({"state__id": np.full(8, 1.5)}, "'state/id' has a value that is no int"),
        ({"state__id": np.full(8, 1e30)}, "'state/id' has a value that is no int"),
        ({"state__id": np.zeros(0)}, "which do not fill the shape"),
        ({"roadgraph_samples__xyz": np.zeros(9)}, "'roadgraph_samples/xyz' has 9"),
        ({"traffic_light_state__past__x": np.zeros(3)}, "differ in their numbers of"),
    ],
)
def test_contradictions_are_named(features: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ScenarioError, match=sentence):
        womd_example.convert(changed(**features))


def test_an_unknown_map_type_is_named() -> None:
    types = protos.example_features(written())["roadgraph_samples/type"].copy()
    types[0] = 4
    with pytest.raises(ScenarioError, match="has 4, which is no MapType"):
        womd_example.convert(changed(roadgraph_samples__type=types))


@pytest.mark.skipif(not REAL_FILE.exists(), reason=files.NO_REAL_DATA)
def test_the_official_sample_holds_what_is_known_of_it() -> None:
    (found,) = womd_example.READER.records(REAL_FILE)
    assert not isinstance(found, BadRecord)
    assert found.scenario_id == "a3bb37c25ce56418"
    assert found.tracks.valid.shape == (128, 91)
    assert (found.ego_index, found.ego_source) == (8, "marked")
    assert len(found.roads.xyz) == 20_000
    assert found.roads.num_features == 254
    assert found.lights.valid.shape == (21, 91)
    assert {231, 236, 237, 355} <= set(found.lights.lane_id.tolist())


@pytest.mark.skipif(not REAL_FILE.exists(), reason=files.NO_REAL_DATA)
def test_velocities_of_the_official_sample_are_those_of_its_positions() -> None:
    (found,) = womd_example.READER.records(REAL_FILE)
    assert not isinstance(found, BadRecord)
    tracks = found.tracks
    both = tracks.valid[:, 1:] & tracks.valid[:, :-1]
    error = np.diff(tracks.xyz[..., :2], axis=1) - tracks.velocity[:, 1:] * found.dt
    assert np.median(np.linalg.norm(error[both], axis=-1)) < MEDIAN_STEP_ERROR
