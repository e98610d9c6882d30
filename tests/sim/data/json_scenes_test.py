"""Tests of the reader of the JSON form of WOMD."""

import copy
import dataclasses
import pathlib
from typing import Any

import numpy as np
import orjson
import pytest

from drivetrain.sim.data import build, json_scenes
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import LightState, MapType, Scenario, ScenarioError
from tests.sim.data import files

ROUNDING = 1e-14  # float64, from radians to degrees and back
REAL_FILES = sorted(
    path
    for folder in ("womd_json", "nocturne")
    for path in (files.REAL_DATA / folder).glob("*.json.gz")
)
MEDIAN_HEADING_ERROR = 0.1  # radians between heading and velocity of what moves


def written(seed: int = 0) -> Scenario:
    """Returns a scenario as the reader should name it."""
    return dataclasses.replace(
        files.scenario(seed),
        dataset="womd_json",
        lane_links=None,
        assumptions=(
            "headings: radians, as none exceeds 6.3",
            "lane links from lane ends, no speed limits",
        ),
    )


def converted(document: Any) -> Scenario:
    """Writes a document and makes a scenario of it."""
    return json_scenes.convert(orjson.dumps(document), fallback_id="file")


def old_document() -> dict[str, Any]:
    """Returns a document with as little as the oldest files have."""
    document = files.json_document(written(), in_degrees=True)
    del document["scenario_id"], document["metadata"]
    document["tl_states"] = {}
    for item in document["objects"]:
        del item["id"], item["height"]
        for place in item["position"]:
            del place["z"]
    for road in document["roads"]:
        del road["id"], road["map_element_id"]
        for place in road["geometry"]:
            del place["z"]
    return document


@pytest.mark.parametrize("seed", range(3))
def test_a_scenario_comes_back(seed: int) -> None:
    wanted = written(seed)
    assert files.differences(converted(files.json_document(wanted)), wanted) == []


def test_degrees_are_told_from_radians() -> None:
    wanted = written()
    found = converted(files.json_document(wanted, in_degrees=True))
    assert found.assumptions == (
        "headings: degrees, as some exceed 6.3",
        "lane links from lane ends, no speed limits",
    )
    same = dataclasses.replace(found, assumptions=wanted.assumptions)
    assert files.differences(same, wanted, ROUNDING) == []


def test_an_old_file_gets_what_it_lacks() -> None:
    wanted = written()
    found = converted(old_document())
    assert found.scenario_id == "file"
    assert found.assumptions == (
        "ego: chosen among the vehicles",
        "headings: degrees, as some exceed 6.3",
        "heights: one for each kind of object",
        "places: at height zero",
        "ids: the places in the lists",
        "kinds of lanes, lines and edges",
        "lane links from lane ends, no speed limits",
    )
    assert (found.ego_index, found.ego_source) == (4, "last")
    assert not found.tracks.is_of_interest.any()
    assert found.tracks.object_id.tolist() == [0, 1, 2, 3, 4]
    assert found.tracks.size[:, 2].tolist() == [1.7, 1.75, 1.8, 1.5, 1.7]
    assert np.array_equal(found.tracks.xyz[..., :2], wanted.tracks.xyz[..., :2])
    assert not found.tracks.xyz[..., 2].any()
    assert set(found.roads.map_type) == {
        *(MapType.LANE_UNDEFINED, MapType.LINE_UNKNOWN, MapType.EDGE_BOUNDARY),
        *(MapType.STOP_SIGN, MapType.CROSSWALK, MapType.SPEED_BUMP, MapType.DRIVEWAY),
    }


def test_an_unknown_code_of_the_map_leaves_the_word() -> None:
    document = files.json_document(written())
    document["roads"][0]["map_element_id"] = -1
    found = converted(document)
    assert found.roads.map_type[0] == MapType.LANE_UNDEFINED
    assert "kinds of lanes, lines and edges" in found.assumptions


def test_an_unknown_state_of_a_light_is_unknown() -> None:
    document = files.json_document(written())
    document["tl_states"]["11"]["state"][0] = "purple"
    assert converted(document).lights.state[0, 0] == LightState.UNKNOWN


@pytest.mark.parametrize(
    ("place", "value", "sentence"),
    [
        (["objects"], {}, "there is no list 'objects'"),
        (["roads"], [], "the list 'roads' is empty"),
        (["objects", 1, "type"], [], r"objects\[1\] is malformed"),
        (["objects", 1], None, r"objects\[1\] is malformed"),
        (["objects", 1, "heading"], [0.0], r"objects\[1\] is malformed: lists have"),
        (["objects", 1, "position", 3], {"x": 1.0}, r"objects\[1\] lacks 'y'"),
        (["objects", 1, "position", 3, "x"], "4.5", r"objects\[1\] is malformed"),
        (["objects", 1, "id"], 1.5, r"objects\[1\] is malformed"),
        (["objects", 1, "position"], {}, r"objects\[1\] is malformed: lists have"),
        (["objects", 1, "position"], {"x": 1}, r"objects\[1\] lacks 0"),
        (["objects", 1, "width"], None, r"objects\[1\] is malformed"),
        (["roads", 2, "type"], "canal", r"roads\[2\] is malformed: 'type' is 'canal'"),
        (["roads", 2, "geometry"], 7, r"roads\[2\] is malformed"),
        (["tl_states"], [1], "'tl_states' must be a mapping"),
        (["tl_states", "lane"], {}, "tl_states lacks 'time_index'"),
        (["tl_states", "11", "x"], [], "the lists of lane 11 differ in length"),
        (["tl_states", "11", "time_index", 0], 91, "told for step 91 of 30"),
        (["metadata"], "none", "'metadata' must be a mapping"),
        (["metadata", "sdc_track_index"], 5, "the ego is marked as track 5"),
        (["metadata", "sdc_track_index"], 0.5, "metadata is malformed"),
        (["metadata", "objects_of_interest"], [2**63], "metadata is malformed"),
        (["metadata", "tracks_to_predict"], [{"track_index": 9}], "names track 9"),
        (["scenario_id"], [1], "'scenario_id' must be a text"),
    ],
)
def test_what_is_malformed_is_named(
    place: list[Any], value: Any, sentence: str
) -> None:
    document = copy.deepcopy(files.json_document(written()))
    part = document
    for step in place[:-1]:
        part = part[step]
    part[place[-1]] = value
    with pytest.raises(ScenarioError, match=sentence):
        converted(document)


@pytest.mark.parametrize("text", [b"{", b'{"objects": NaN}', b"[" * 10**6, b"[]", b"7"])
def test_text_that_is_no_json_of_womd_is_an_error(text: bytes) -> None:
    with pytest.raises(ScenarioError, match=r"no valid JSON|no list 'objects'"):
        json_scenes.convert(text, fallback_id="file")


def test_a_map_of_argoverse_is_answered_with_what_to_name() -> None:
    text = orjson.dumps({"lane_segments": {}, "drivable_areas": {}})
    with pytest.raises(ScenarioError, match=r"name the \.parquet file beside it"):
        json_scenes.convert(text, fallback_id="file")


@pytest.mark.parametrize("name", ["scene.json", "scene.json.gz", "scene"])
def test_a_file_names_the_scenario_that_has_no_id(
    tmp_path: pathlib.Path, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(orjson.dumps(old_document()))
    (found,) = json_scenes.READER.records(path)
    assert isinstance(found, Scenario)
    assert found.scenario_id == "scene"


@pytest.mark.skipif(not REAL_FILES, reason=files.NO_REAL_DATA)
def test_the_real_files_are_read_but_for_three_that_are_too_short() -> None:
    found = [item for path in REAL_FILES for item in build.read(path)]
    bad = [item for item in found if isinstance(item, BadRecord)]
    assert len(found) - len(bad) >= 42
    assert len(bad) == 3
    assert all("too short: 11 steps" in item.reason for item in bad)


@pytest.mark.skipif(not REAL_FILES, reason=files.NO_REAL_DATA)
@pytest.mark.parametrize("index", range(0, len(REAL_FILES), 8))
def test_real_cars_head_where_they_go(index: int) -> None:
    (found,) = json_scenes.READER.records(REAL_FILES[index])
    assert isinstance(found, Scenario)
    velocity, yaw = found.tracks.velocity, found.tracks.yaw
    moving = found.tracks.valid & (np.linalg.norm(velocity, axis=-1) > 3.0)
    turn = np.arctan2(velocity[..., 1], velocity[..., 0]) - yaw
    error = np.abs(np.angle(np.exp(1j * turn)))[moving]
    assert np.median(error) < MEDIAN_HEADING_ERROR


def test_a_text_of_too_many_values_is_not_parsed() -> None:
    text = b'{"roads": [1], "objects": [' + b"{}," * (1 << 20) + b"1]}"
    with pytest.raises(ScenarioError, match="the text has about 2097156 values"):
        json_scenes.convert(text, fallback_id="file")
