"""Tests of the maps, signs and lights of CommonRoad."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pytest

from drivetrain.sim.data import (
    commonroad_lights,
    commonroad_map,
    commonroad_signs,
)
from drivetrain.sim.scenario import (
    EDGES,
    LANES,
    LaneLinks,
    Lights,
    LightState,
    MapType,
    Polylines,
    ScenarioError,
)
from tests.sim.data import commonroad_files, files

EXACT = 1e-12  # metres: float64, means of coordinates of some 100 m
LIMITS = {"274": 8.0, "R2-1": 9.0}  # metres per second, by sign


def document(version: str = "2020a") -> Element:
    """Returns the document of the test scenario."""
    return commonroad_files.document(files.scenario(), version)


def read(root: Element) -> tuple[Polylines, LaneLinks, Lights]:
    """Returns roads, links and lights of a document."""
    signs = commonroad_signs.read(root)
    lanes = commonroad_map.lanes(root, signs)
    return (
        commonroad_map.roads(root, lanes, signs),
        commonroad_map.links(lanes, signs),
        commonroad_lights.read(root, lanes, np.arange(30.0)),
    )


def first(root: Element, path: str) -> Element:
    """Returns the first element of a path."""
    found = root.find(path)
    assert found is not None
    return found


def strip(
    name: int, start: tuple[float, float], end: tuple[float, float], inside: str = ""
) -> Element:
    """Returns a straight lanelet, four metres wide."""
    along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    left = 2 * np.array([-along[1], along[0]])
    element = ElementTree.fromstring(f'<lanelet id="{name}">{inside}</lanelet>')
    for tag, side in (("leftBound", left), ("rightBound", -left)):
        bound = np.zeros((2, 3))
        bound[:, :2] = np.stack([start + side, end + side])
        commonroad_files.places(SubElement(element, tag), bound)
    return element


def beside(side: str, name: int, direction: str) -> str:
    """Returns the reference to an adjacent lanelet."""
    return f'<adjacent{side} ref="{name}" drivingDir="{direction}"/>'


def edges_of(roads: Polylines) -> list[list[list[float]]]:
    """Returns the ends of the road's edges, rounded to the millimetre."""
    rows = np.isin(roads.map_type, EDGES).nonzero()[0].tolist()
    ends = [roads.points_of(row)[[0, -1], :2] for row in rows]
    return sorted((np.round(pair, 3) + 0.0).tolist() for pair in ends)


@pytest.mark.parametrize("version", ["2018b", "2020a"])
def test_lanes_and_links_come_back(version: str) -> None:
    wanted = files.scenario()
    roads, links, _ = read(document(version))
    assert wanted.lane_links is not None
    has_types = version == "2020a"
    wanted_kinds = wanted.roads.map_type[:3].tolist() if has_types else [0, 0, 0]
    assert roads.map_type[:3].tolist() == wanted_kinds
    assert roads.feature_id[:3].tolist() == wanted.roads.feature_id[:3].tolist()
    for lane in range(3):
        ends = roads.points_of(lane)[[0, -1]]
        wanted_ends = wanted.roads.points_of(lane)[[0, -1]]
        assert np.allclose(ends, wanted_ends, rtol=0, atol=EXACT)
    stops = wanted.lane_links.stop if has_types else np.zeros((0, 2), np.int64)
    for name in ("successor", "neighbor", "limited", "limit"):
        wanted_links = getattr(wanted.lane_links, name)
        assert np.array_equal(getattr(links, name), wanted_links), name
    assert np.array_equal(links.stop, stops)


def test_stop_signs_and_crosswalks_come_back() -> None:
    wanted = files.scenario().roads
    roads, _, _ = read(document())
    for kind in (MapType.STOP_SIGN, MapType.CROSSWALK):
        one, other = (
            item.points_of(int((item.map_type == kind).argmax()))
            for item in (roads, wanted)
        )
        assert np.allclose(one, other, rtol=0, atol=EXACT)


def test_a_stop_sign_without_a_place_stands_at_the_end_of_its_lane() -> None:
    root = document()
    sign = first(root, "trafficSign")
    sign.remove(first(sign, "position"))
    roads, links, _ = read(root)
    place = roads.points_of(int((roads.map_type == MapType.STOP_SIGN).argmax()))
    lane = roads.feature_id.tolist().index(int(links.stop[0, 1]))
    assert np.allclose(place[0], roads.points_of(lane)[-1], rtol=0, atol=EXACT)


def test_the_lowest_of_several_limits_holds() -> None:
    signs = [
        commonroad_files.sign(i, kind, str(value))
        for i, (kind, value) in enumerate(LIMITS.items())
    ]
    refs = "".join(f'<trafficSignRef ref="{i}"/>' for i in range(len(signs)))
    root = Element("commonRoad")
    root.append(strip(5, (0, 0), (10, 0), refs))
    root.extend(signs)
    _, links, _ = read(root)
    assert (links.limited.tolist(), links.limit.tolist()) == ([5], [8.0])


def test_a_sidewalk_is_no_road() -> None:
    root = Element("commonRoad")
    root.append(strip(1, (0, 0), (10, 0)))
    kind = "<laneletType>sidewalk</laneletType>"
    root.append(strip(2, (0, 4), (10, 4), kind))
    roads, _, _ = read(root)
    assert roads.feature_id[np.isin(roads.map_type, LANES)].tolist() == [1]
    assert edges_of(roads) == [[[0, -2], [10, -2]], [[10, 2], [0, 2]]]


def test_lanes_side_by_side_make_one_road_in_both_directions() -> None:
    root = Element("commonRoad")
    root.append(strip(1, (0, 0), (10, 0), beside("Left", 2, "same")))
    both = beside("Right", 1, "same") + beside("Left", 3, "opposite")
    root.append(strip(2, (0, 4), (10, 4), both))
    root.append(strip(3, (10, 8), (0, 8), beside("Left", 2, "opposite")))
    roads, links, _ = read(root)
    assert links.neighbor.tolist() == [[1, 2], [2, 1]]
    assert edges_of(roads) == [[[0, -2], [10, -2]], [[10, 10], [0, 10]]]


def test_lanes_that_cross_in_a_junction_leave_no_edge_across() -> None:
    root = Element("commonRoad")
    root.append(strip(1, (-20, 0), (20, 0)))
    root.append(strip(2, (0, -20), (0, 20)))
    roads, _, _ = read(root)
    # Four corners, each from one arm to the next one.
    assert edges_of(roads) == sorted(
        [
            *([[20, 2], [2, 20]], [[-2, 20], [-20, 2]]),
            *([[-20, -2], [-2, -20]], [[2, -20], [20, -2]]),
        ]
    )


def test_an_exit_divides_the_edge_where_it_leaves() -> None:
    root = Element("commonRoad")
    root.append(strip(1, (0, 0), (20, 0), '<successor ref="2"/><successor ref="3"/>'))
    root.append(strip(2, (20, 0), (60, 0), '<predecessor ref="1"/>'))
    root.append(strip(3, (20, 0), (60, -20), '<predecessor ref="1"/>'))
    roads, _, _ = read(root)
    ends = edges_of(roads)
    assert len(ends) == 3  # left of all, right of all, and around the wedge
    assert [[60, 2], [0, 2]] in ends


def test_lights_come_back() -> None:
    wanted = commonroad_files.as_told(files.scenario()).lights
    _, _, lights = read(document())
    assert files.differences(lights, wanted, EXACT) == []


def light(*colours: tuple[str, str]) -> tuple[Element, Element]:
    """Returns a light with a cycle of colours and durations, and its lane."""
    element = Element("trafficLight", id="9")
    cycle = SubElement(element, "cycle")
    for colour, duration in colours:
        part = SubElement(cycle, "cycleElement")
        SubElement(part, "color").text = colour
        SubElement(part, "duration").text = duration
    return element, strip(1, (0, 0), (10, 0), '<trafficLightRef ref="9"/>')


def test_a_light_repeats_its_cycle_at_the_end_of_a_lane_without_a_line() -> None:
    root = Element("commonRoad")
    root.extend(light(("red", "2"), ("redYellow", "1"), ("green", "3"), ("odd", "1")))
    _, _, lights = read(root)
    stop, go, dark = LightState.STOP, LightState.GO, LightState.UNKNOWN
    cycle = [*[stop] * 3, *[go] * 3, dark]
    assert lights.state[0].tolist() == (cycle * 5)[:30]
    assert lights.xyz.tolist() == [[10, 0, 0]]
    assert lights.valid.all()


def test_a_light_of_several_lanes_is_read_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    root = Element("commonRoad")
    root.extend(light(("red", "2"), ("green", "3")))
    root.append(strip(2, (0, 9), (10, 9), '<trafficLightRef ref="9"/>'))
    read_states, told = commonroad_lights._states, []

    def counted(element: Element, steps: np.ndarray) -> np.ndarray:
        told.append(element.get("id"))
        return read_states(element, steps)

    monkeypatch.setattr(commonroad_lights, "_states", counted)
    _, _, lights = read(root)
    assert told == ["9"]
    assert (lights.state[0] == lights.state[1]).all()


def test_a_light_that_is_switched_off_is_none() -> None:
    root = Element("commonRoad")
    root.extend(light(("red", "2")))
    SubElement(first(root, "trafficLight"), "active").text = "false"
    assert not len(read(root)[2].lane_id)


@pytest.mark.parametrize("colours", [[], [("red", "0")], [("red", "-1")]])
def test_a_cycle_without_duration_is_named(colours: list[tuple[str, str]]) -> None:
    root = Element("commonRoad")
    root.extend(light(*colours))
    with pytest.raises(ScenarioError, match="the cycle of light 9 has no duration"):
        read(root)


def test_too_many_lights_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commonroad_lights.parts, "MAX_LIGHT_STEPS", 29)
    root = Element("commonRoad")
    root.extend(light(("red", "2")))
    with pytest.raises(ScenarioError, match="1 lanes with lights are too many"):
        read(root)


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("dashed", MapType.LINE_BROKEN_SINGLE_WHITE),
        ("broad_solid", MapType.LINE_SOLID_SINGLE_WHITE),
        ("unknown", MapType.LINE_UNKNOWN),
        ("no_marking", None),
    ],
)
def test_markings_become_lines(word: str, kind: MapType | None) -> None:
    root = Element("commonRoad")
    root.append(strip(1, (0, 0), (10, 0)))
    SubElement(first(root, "lanelet/rightBound"), "lineMarking").text = word
    roads, _, _ = read(root)
    others = roads.map_type[~np.isin(roads.map_type, (*LANES, *EDGES))].tolist()
    assert others == ([] if kind is None else [kind])
