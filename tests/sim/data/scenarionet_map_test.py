"""Tests of what becomes of the map features of ScenarioNet."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from drivetrain.sim.data import scenarionet, scenarionet_map
from drivetrain.sim.scenario import MapType, Scenario
from tests.sim.data import files, formats, pickles

ROUNDING = 1e-12  # float64, from metres per second to kilometres per hour and back


def written() -> Scenario:
    """Returns a scenario without links to nowhere."""
    return formats.with_known_links(files.scenario())


def converted(document: Any) -> Scenario:
    """Makes a scenario of a document."""
    return scenarionet.convert(document, "file")


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        (["7", "11"], [7, 11]),
        (["b", "a"], [0, 1]),
        (["7", "a"], [0, 1]),
        (["7", "07"], [0, 1]),
        (["9" * 19], [0]),
        (["-1"], [0]),
        (["\u0663"], [0]),  # a digit, of another script
        ([], []),
    ],
)
def test_names_are_the_numbers_that_they_spell_or_their_places(
    names: list[str], wanted: list[int]
) -> None:
    assert list(scenarionet_map.numbers(names).values()) == wanted


@pytest.mark.parametrize(
    "values",
    [
        [[1.0, 2.0], [3.0, 4.0]],
        [(1, 2), [3, 4]],
        [np.array([1, 2], np.int8), np.array([3, 4], np.int8)],
        np.array([[1, 2], [3, 4]], np.uint16),
    ],
)
def test_rows_may_be_lists_tuples_or_arrays(values: Any) -> None:
    assert scenarionet_map.floats(values).tolist() == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize(
    "values",
    [
        *("12", {"x": 1.0}, 7, None, [1.0, None], [1.0, "2"], [b"12", b"34"]),
        *([[1.0, [2.0]]], [[1.0], [[2.0]]], [[1.0], [2.0, 3.0]], np.array(["1"])),
        *(
            [np.array(1.0)],
            [np.array([1.0]), [1.0, 2.0]],
            [np.array([1.0]), [1.0, "2"]],
        ),
    ],
)
def test_what_is_no_numbers_is_refused(values: Any) -> None:
    with pytest.raises((TypeError, ValueError)):
        scenarionet_map.floats(values)


def renamed(document: dict[str, Any]) -> dict[str, Any]:
    """Returns the document with map features that are named by words."""
    named = {str(number): f"lane-{number}" for number in range(11, 22)}

    def word(name: Any) -> str:
        return named.get(str(name), "elsewhere")

    features = {}
    for name, feature in document["map_features"].items():
        for field in ("entry_lanes", "exit_lanes", "lane"):
            if field in feature:
                feature[field] = [word(lane) for lane in feature[field]]
        for field in ("left_neighbor", "right_neighbor"):
            if field in feature:
                feature[field] = [word(lane["feature_id"]) for lane in feature[field]]
        features[word(name)] = feature
    lights = {word(n): light for n, light in document["dynamic_map_states"].items()}
    return document | {"map_features": features, "dynamic_map_states": lights}


def test_names_that_are_words_are_numbered_in_their_order() -> None:
    wanted, found = written(), converted(renamed(pickles.document(written())))
    assert wanted.lane_links is not None
    assert found.lane_links is not None
    first = wanted.roads.feature_id[0]
    assert np.array_equal(found.roads.feature_id, wanted.roads.feature_id - first)
    assert np.array_equal(found.lights.lane_id, wanted.lights.lane_id - first)
    for name in ("successor", "neighbor", "stop", "limited"):
        numbers = getattr(wanted.lane_links, name) - first
        assert np.array_equal(getattr(found.lane_links, name), numbers)


def test_lanes_inside_junctions_are_surface_streets() -> None:
    document = pickles.document(written())
    wanted = converted(document).roads.map_type
    names = [name for name in document["map_features"] if name in ("11", "12")]
    for name in names:
        document["map_features"][name]["type"] = "LANE_SURFACE_UNSTRUCTURE"
    found = converted(document)
    street = wanted.copy()
    street[:2] = MapType.LANE_SURFACE_STREET
    assert len(names) == 2 and (wanted != street).any()
    assert np.array_equal(found.roads.map_type, street)


def flat_document() -> dict[str, Any]:
    """Returns a document as nuScenes has it: no heights, and rings around roads."""
    document = pickles.document(dataclasses.replace(written(), lane_links=None))
    square = np.array([[0.0, 0.0], [0.0, 9.0], [9.0, 9.0], [9.0, 0.0], [0.0, 0.0]])
    lane = np.array([[1.0, 1.0, 3.14], [2.0, 2.0, -3.14]])
    line = "ROAD_LINE_SOLID_SINGLE_WHITE"
    return document | {
        "map_features": {
            "uuid": {"type": "LANE_SURFACE_STREET", "polyline": lane.tolist()},
            "boundary_0": {"type": line, "polyline": square},
            "boundary_1": {"type": line, "polyline": square[:3]},
            "divider": {"type": line, "polyline": square},
        }
    }


def test_outlines_of_the_drivable_area_are_road_edges() -> None:
    found = converted(flat_document())
    assert found.roads.map_type.tolist() == [2, MapType.EDGE_BOUNDARY, 7, 7]
    edge = found.roads.points_of(1)
    assert edge[:, :2].tolist() == [[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]]
    assert "road edges: from outlines of the drivable area" in found.assumptions


def test_a_map_of_two_columns_is_flat_and_so_is_its_traffic() -> None:
    found = converted(flat_document())
    assert not found.roads.xyz[:, 2].any()
    assert not found.tracks.xyz[..., 2].any()
    assert "no heights" in found.assumptions


def test_a_map_without_links_has_none() -> None:
    found = converted(flat_document())
    assert found.lane_links is None
    assert "lane links from lane ends, no speed limits" in found.assumptions


def test_a_map_whose_lanes_name_no_other_has_links_all_the_same() -> None:
    document = pickles.document(written())
    for feature in document["map_features"].values():
        for field in ("entry_lanes", "exit_lanes", "left_neighbor", "right_neighbor"):
            feature |= {field: []} if field in feature else {}
        feature |= {"lane": []} if "lane" in feature else {}
    links, wanted = converted(document).lane_links, written().lane_links
    assert links is not None
    assert wanted is not None
    assert len(links.successor) == len(links.neighbor) == len(links.stop) == 0
    assert np.allclose(links.limit, wanted.limit, rtol=0.0, atol=ROUNDING)
