"""Tests of the maps of Argoverse 2."""

from typing import Any

import orjson
import pytest

from drivetrain.sim.data import argoverse2_map
from drivetrain.sim.scenario import MapType, ScenarioError
from tests.sim.data import argoverse2_files, files


@pytest.mark.parametrize("is_turned", [False, True])
def test_a_crosswalk_is_a_ring_whichever_way_its_edges_go(is_turned: bool) -> None:
    edge1, edge2 = ([[0, 0], [9, 0]], [[0, 3], [9, 3]])
    if is_turned:
        edge2.reverse()
    crossing = {
        name: [{"x": x, "y": y, "z": 0} for x, y in edge]
        for name, edge in (("edge1", edge1), ("edge2", edge2))
    }
    document = argoverse2_files.map_document(files.scenario())
    document["pedestrian_crossings"] = {"5": {"id": 5, **crossing}}
    roads, _ = argoverse2_map.convert(orjson.dumps(document))
    ring = roads.points_of(int((roads.map_type == MapType.CROSSWALK).argmax()))
    assert ring[:, :2].tolist() == [[0, 0], [9, 0], [9, 3], [0, 3], [0, 0]]


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("DOUBLE_SOLID_YELLOW", MapType.LINE_SOLID_DOUBLE_YELLOW),
        ("SOLID_DASH_YELLOW", MapType.LINE_PASSING_DOUBLE_YELLOW),
        ("DASHED_WHITE", MapType.LINE_BROKEN_SINGLE_WHITE),
        ("SOLID_BLUE", MapType.LINE_UNKNOWN),
        ("NONE", None),
    ],
)
def test_marks_become_lines(word: str, kind: MapType | None) -> None:
    document = argoverse2_files.map_document(files.scenario())
    for segment in document["lane_segments"].values():
        segment["left_lane_mark_type"] = word
    roads, _ = argoverse2_map.convert(orjson.dumps(document))
    painted = (roads.map_type >= 5) & (roads.map_type <= 13)
    assert roads.map_type[painted].tolist() == ([] if kind is None else [kind] * 3)


@pytest.mark.parametrize(
    ("place", "value", "sentence"),
    [
        (["lane_segments"], [], "its map has no mapping 'lane_segments'"),
        (["lane_segments", "11", "id"], "11", "map: lane segment 11 is malformed"),
        (["lane_segments", "11", "successors"], [None], "segment 11 is malformed"),
        (["lane_segments", "11", "left_lane_boundary"], [], "has bounds of 0 and 5"),
        (["drivable_areas", "7"], {}, "drivable area 7 lacks 'area_boundary'"),
        (["pedestrian_crossings", "19", "edge1"], [{}], "crossing 19 lacks 'x'"),
        (["pedestrian_crossings", "19", "edge2"], [], "an edge has no points"),
    ],
)
def test_what_is_wrong_with_a_map_is_named(
    place: list[str], value: Any, sentence: str
) -> None:
    part = document = argoverse2_files.map_document(files.scenario())
    for name in place[:-1]:
        part = part[name]
    part[place[-1]] = value
    with pytest.raises(ScenarioError, match=sentence):
        argoverse2_map.convert(orjson.dumps(document))


@pytest.mark.parametrize("text", [b"{", b"[]", b"7", b"[" * 10**5])
def test_text_that_is_no_map_is_named(text: bytes) -> None:
    with pytest.raises(
        ScenarioError, match=r"its map (is no valid JSON|has no mapping)"
    ):
        argoverse2_map.convert(text)


@pytest.mark.parametrize("part", ["drivable_areas", "lane_segments"])
def test_a_map_is_told_from_its_first_part(part: str) -> None:
    head = b'\xef\xbb\xbf {\n "' + part.encode() + b'": {'
    assert argoverse2_map.is_map(head)
    assert not argoverse2_map.is_map(b'{"name": "' + part.encode() + b'"')
