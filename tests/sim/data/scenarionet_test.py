"""Tests of the reader of the pickles of ScenarioNet."""

import copy
import dataclasses
import functools
import pathlib
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivetrain.sim.data import plain_pickle, scenarionet
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import (
    DRIVING_LANES,
    LANES,
    Scenario,
    ScenarioError,
)
from tests.sim.data import files, formats, pickles, sides

REAL_FILES = sorted((files.REAL_DATA / "scenarionet").glob("*.pkl"))
ROUNDING = 1e-12  # float64, from miles per hour to kilometres and back
SPEED_ERROR = 0.2  # metres per second: places are rounded to a centimetre, 0.1 s apart
SLOW = 1.0  # metres per second, below which nothing can be told from noise
MPH = 0.44704
MOSTLY = 0.97  # of the steps: a car may touch the gutter, a map leave out a yard


def written(seed: int = 0) -> Scenario:
    """Returns a scenario as the reader should name it, without links to nowhere."""
    wanted = formats.with_known_links(files.scenario(seed))
    return dataclasses.replace(wanted, dataset="scenarionet")


def converted(document: Any) -> Scenario:
    """Writes a document and makes a scenario of it."""
    return scenarionet.convert(plain_pickle.loads(pickle.dumps(document)), "file")


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("seed", range(2))
def test_a_scenario_comes_back(
    tmp_path: pathlib.Path, seed: int, protocol: int
) -> None:
    path = tmp_path / "sd_x.pkl"
    path.write_bytes(pickles.scenarionet_file(files.scenario(seed), protocol))
    (found,) = scenarionet.READER.records(path)
    assert files.differences(found, written(seed), ROUNDING) == []


def older(wanted: Scenario) -> dict[str, Any]:
    """Returns a document as older versions wrote it."""
    document = pickles.document(wanted)
    for track in document["tracks"].values():
        state = track["state"]
        sizes = [state.pop(name)[:, None] for name in ("length", "width", "height")]
        state["size"] = np.concatenate(sizes, axis=1).astype(np.float32)
        state["valid"] = state["valid"].astype(np.float64)
    for feature in document["map_features"].values():
        if feature["type"] == "CROSSWALK":
            feature |= {"type": "CROSS_WALK", "polyline": feature.pop("polygon")}
        limit = feature.pop("speed_limit_kmh", None)
        if limit is not None:
            feature["speed_limit_mph"] = limit / 1.609344
    for index, light in enumerate(document["dynamic_map_states"].values()):
        seen = wanted.lights.valid[index]
        place = np.where(seen[:, None], light.pop("stop_point"), 0.0)
        shown = np.where(seen, wanted.lights.state[index], 0)
        lane = np.where(seen, light.pop("lane"), 0)
        light["state"] = {"object_state": shown, "stop_point": place, "lane": lane}
    return document


def test_older_files_say_the_same() -> None:
    wanted = written()
    assert files.differences(converted(older(wanted)), wanted, ROUNDING) == []


def test_sizes_may_be_columns() -> None:
    document = pickles.document(written())
    for track in document["tracks"].values():
        for name in ("length", "width", "height"):
            track["state"][name] = track["state"][name][:, None]
    assert files.differences(converted(document).tracks, written().tracks) == []


def test_two_tracks_of_one_name_are_refused() -> None:
    document = pickles.document(written())
    name = next(iter(document["tracks"]))
    document["tracks"][int(name)] = document["tracks"][name]
    with pytest.raises(ScenarioError, match="two tracks have the same name"):
        converted(document)


def test_an_ego_that_is_wider_than_long_is_turned() -> None:
    document = pickles.document(written())
    ego = document["tracks"][document["metadata"]["sdc_id"]]["state"]
    document["metadata"]["dataset"] = "nuscenes"
    ego["length"], ego["width"] = np.full(30, 1.73), np.full(30, 4.08)
    found = converted(document)
    assert found.tracks.size[found.ego_index, :2].tolist() == [4.08, 1.73]
    assert found.assumptions == ("length and width of the ego are swapped",)


@pytest.mark.parametrize(
    ("metadata", "step", "dt"),
    [
        ({"current_time_index": 3}, 3, 0.1),
        ({"ts": np.arange(30) * 0.1}, 10, 0.1),
        ({"ts": (np.arange(30) * 0.0999905).tolist()}, 10, 0.1),
        ({"ts": np.arange(30) * 0.5}, 2, 0.5),
        ({"sample_rate": 0.2}, 5, 0.2),
        ({}, 10, 0.1),
    ],
)
def test_the_current_step_is_that_of_the_file_or_after_a_second(
    metadata: dict[str, Any], step: int, dt: float
) -> None:
    document = pickles.document(written())
    document["metadata"] = {"sdc_id": document["metadata"]["sdc_id"]} | metadata
    found = converted(document)
    assert (found.current_step, found.dt) == (step, dt)
    assert ("steps of 0.1 s" in found.assumptions) == (
        not metadata.keys() - {"current_time_index"}
    )


def test_a_file_without_a_mark_has_its_ego_chosen() -> None:
    document = pickles.document(written())
    del document["metadata"]["sdc_id"]
    assert converted(document).ego_source == "last"


def test_kinds_and_states_that_are_not_known_are_told() -> None:
    document = pickles.document(written())
    document["map_features"]["11"]["type"] = "CANAL"
    document["dynamic_map_states"]["12"]["state"]["object_state"][0] = "PURPLE"
    found = converted(document)
    assert 11 not in found.roads.feature_id
    assert found.lights.state[1, 0] == 0
    assert found.assumptions == ("left out of the map: CANAL", "light unknown: PURPLE")


@pytest.mark.parametrize(
    "names", [{"sd_a.pkl": {"x": 1}}, {"sd_a.pkl": ".", "b.pkl": ""}]
)
def test_the_lists_beside_a_data_set_hold_nothing(
    tmp_path: pathlib.Path, names: dict[str, Any]
) -> None:
    path = tmp_path / "dataset_summary.pkl"
    path.write_bytes(pickle.dumps(names))
    assert list(scenarionet.READER.records(path)) == []


@pytest.mark.parametrize(
    ("place", "value", "sentence"),
    [
        (["tracks"], [], "there is no mapping 'tracks'"),
        (["map_features"], {}, "the mapping 'map_features' is empty"),
        (
            ["dynamic_map_states"],
            [1],
            "dynamic_map_states is malformed: a list where a",
        ),
        (["id"], 7, "'id' must be a text, got a int"),
        (["metadata", "sdc_id"], "none", "marked as 'none', which is no track"),
        (["metadata", "sdc_id"], [], "marked as list, which is no track"),
        (["metadata", "current_time_index"], -1, "must be a number of a step, got -1"),
        (
            ["metadata", "current_time_index"],
            "x",
            "must be a number of a step, got str",
        ),
        (["metadata", "ts"], [[1.0]], "'ts' is no list of times"),
        (["metadata", "ts"], np.zeros(30), "the times of the steps do not rise"),
        (["metadata", "tracks_to_predict"], 3, "metadata is malformed"),
        (["tracks", "EGO"], None, "tracks.*is malformed"),
        (
            ["tracks", "EGO", "state", "heading"],
            np.zeros(29),
            "'heading' has the shape",
        ),
        (["tracks", "EGO", "state", "valid"], np.zeros((30, 2)), "'valid' has 2 dim"),
        (["tracks", "EGO", "state", "position"], ["x"], "a str where a number belongs"),
        (["tracks", "EGO", "state", "velocity"], np.array(["x"]), "an array of <U1"),
        (["map_features", "11", "polyline"], [[1.0], [1.0, 2.0]], "different lengths"),
        (["map_features", "11", "polyline"], np.zeros((3, 7)), "has the shape"),
        (["map_features", "11", "exit_lanes"], [None], "'exit_lanes' names a NoneType"),
        (["map_features", "11", "type"], 7, "its type is a int"),
        (["dynamic_map_states", "11", "state"], {}, "lacks 'object_state'"),
        (["dynamic_map_states", "11", "stop_point"], [1.0, 2.0], "is malformed"),
        (
            ["dynamic_map_states", "11", "state", "object_state"],
            ["LANE_STATE_GO"] * 99,
            "told for step 30 of 30",
        ),
    ],
)
def test_what_is_malformed_is_named(
    place: list[Any], value: Any, sentence: str
) -> None:
    document = copy.deepcopy(pickles.document(written()))
    part, ego = document, document["metadata"]["sdc_id"]
    place = [ego if step == "EGO" else step for step in place]
    for step in place[:-1]:
        part = part[step]
    part[place[-1]] = value
    with pytest.raises(ScenarioError, match=sentence):
        converted(document)


@functools.cache
def real(path: pathlib.Path) -> Scenario:
    """Reads a real file, once."""
    (found,) = scenarionet.READER.records(path)
    assert not isinstance(found, BadRecord), found.reason
    return found


def of_real_files(test: Callable[..., None]) -> Callable[..., None]:
    """Runs a test on each real file."""
    for mark in (
        pytest.mark.skipif(not REAL_FILES, reason=files.NO_REAL_DATA),
        pytest.mark.filterwarnings("ignore:numpy.core"),  # its name before NumPy 2
        pytest.mark.parametrize("path", REAL_FILES, ids=lambda path: path.stem),
    ):
        test = mark(test)
    return test


@of_real_files
def test_everything_of_a_real_file_is_there(path: pathlib.Path) -> None:
    found, raw = real(path), pickles.trusted(path)
    states = [track["state"] for track in raw["tracks"].values()]
    assert found.scenario_id == raw["id"]
    assert found.tracks.valid.shape == (len(states), raw["length"])
    assert found.tracks.valid.sum() == sum(state["valid"].sum() for state in states)
    assert found.roads.num_features == len(raw["map_features"])
    seen = 0
    for light in raw["dynamic_map_states"].values():
        shown = light["state"]["object_state"]
        lane = light["state"].get("lane", [state is not None for state in shown])
        seen += np.count_nonzero(lane)
    assert found.lights.valid.sum() == seen


@of_real_files
def test_real_objects_move_as_fast_as_they_say(path: pathlib.Path) -> None:
    tracks, dt = real(path).tracks, real(path).dt
    both = tracks.valid[:, 1:] & tracks.valid[:, :-1]
    step = np.diff(tracks.xyz[..., :2], axis=1) / dt
    mean = (tracks.velocity[:, 1:] + tracks.velocity[:, :-1]) / 2
    error = np.linalg.norm(step - mean, axis=-1)[both]
    moving = np.linalg.norm(mean, axis=-1)[both] > SLOW
    assert np.median(error[moving]) < SPEED_ERROR


@of_real_files
def test_real_egos_keep_to_the_left_of_the_edges(path: pathlib.Path) -> None:
    found = real(path)
    assert found.ego_source == "marked"
    assert sides.share_left_of_edges(found) > MOSTLY


@of_real_files
def test_real_lights_stand_on_lanes(path: pathlib.Path) -> None:
    found = real(path)
    lanes = found.roads.feature_id[np.isin(found.roads.map_type, LANES)]
    assert np.isin(found.lights.lane_id, lanes).all()


@of_real_files
def test_real_lanes_have_links_and_limits_in_womd_alone(path: pathlib.Path) -> None:
    links = real(path).lane_links
    assert (links is not None) == ("waymo" in path.stem)
    if links is not None:
        lanes = real(path).roads.map_type
        is_lane = np.isin(lanes, DRIVING_LANES)
        assert len(links.successor) > is_lane.sum() / 2
        assert set(np.round(links.limit / MPH).astype(int)) <= set(range(5, 80, 5))
