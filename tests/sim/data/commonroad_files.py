"""Writes scenarios as CommonRoad has them, in both versions of its XML.

The format carries less than a scenario: see `as_told` for what comes back.
"""

import dataclasses
import pathlib
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement
from xml.sax import saxutils

import numpy as np

from drivetrain.sim.scenario import (
    LANES,
    Lights,
    LightState,
    MapType,
    ObjectType,
    Scenario,
)
from tests.sim.data import files

HALF_WIDTH = np.array([0.0, 1.5, 0.0])  # from the centre line to the bounds [m]
WORDS = {
    ObjectType.VEHICLE: "car",
    ObjectType.PEDESTRIAN: "pedestrian",
    ObjectType.CYCLIST: "bicycle",
    ObjectType.OTHER: "unknown",
}
LANE_WORDS = {
    MapType.LANE_FREEWAY: "interstate",
    MapType.LANE_SURFACE_STREET: "urban",
    MapType.LANE_BIKE: "bicycleLane",
}
COLOURS = {LightState.STOP: "red", LightState.CAUTION: "yellow", LightState.GO: "green"}
FIRST_LIGHT, FIRST_LIMIT = 1000, 2000  # ids


def write(
    wanted: Scenario, folder: pathlib.Path, version: str = "2020a"
) -> pathlib.Path:
    """Writes a scenario in one of the two versions; returns the file to read."""
    path = folder / f"{wanted.scenario_id}.xml"
    path.write_bytes(ElementTree.tostring(document(wanted, version)))
    return path


def text(wanted: Scenario) -> bytes:
    """Encodes a scenario in the newer version."""
    return ElementTree.tostring(document(wanted, "2020a"))


def as_lists(element: Element) -> list[Any]:
    """Returns an element as its tag, attributes, text, and then its children."""
    children = [as_lists(child) for child in element]
    return [element.tag, dict(element.attrib), element.text or "", *children]


def markup(told: Any) -> bytes:
    """Encodes what lists tell of elements, values of other kinds as text."""
    return _markup(told).encode()


def _markup(told: Any) -> str:
    match told:
        case [tag, dict(attributes), value, *children] if isinstance(tag, str):
            names = "".join(
                f" {name}={saxutils.quoteattr(str(attribute))}"
                for name, attribute in attributes.items()
            )
            content = "".join(map(_markup, [value, *children]))
            return f"<{tag}{names}>{content}</{tag}>"
    return saxutils.escape(str(told))


def as_told(wanted: Scenario) -> Scenario:
    """Returns the scenario with what XML can tell: speeds along the yaw, whole lights.

    The map of version 2018b has no types and no lights.
    """
    tracks, lights = wanted.tracks, wanted.lights
    heading = np.stack([np.cos(tracks.yaw), np.sin(tracks.yaw)], axis=-1)
    speed = (tracks.velocity * heading).sum(axis=-1, keepdims=True)
    state = np.where(np.isin(lights.state, list(COLOURS)), lights.state, 0)
    return dataclasses.replace(
        wanted,
        ego_source="last",
        tracks=dataclasses.replace(
            tracks,
            velocity=speed * heading * tracks.valid[..., None],
            is_of_interest=np.zeros(len(tracks.valid), bool),
        ),
        lights=Lights(
            lane_id=lights.lane_id,
            xyz=lights.xyz,
            state=state,
            valid=np.ones_like(lights.valid),
        ),
    )


def document(wanted: Scenario, version: str) -> Element:
    """Returns the root of a document in version 2018b or 2020a."""
    root = Element(
        "commonRoad",
        benchmarkID=wanted.scenario_id,
        commonRoadVersion=version,
        timeStepSize=repr(wanted.dt),
    )
    for i, kind in enumerate(wanted.roads.map_type.tolist()):
        if kind in LANES or (kind == MapType.CROSSWALK and version == "2020a"):
            root.append(lanelet(wanted, i, version))
    if version == "2020a":
        root.extend(signs(wanted))
        root.extend(traffic_lights(wanted))
    root.extend(obstacle(wanted, i, version) for i in range(len(wanted.tracks.valid)))
    SubElement(root, "planningProblem", id="9000")
    return root


def lanelet(wanted: Scenario, feature: int, version: str) -> Element:
    """Returns a lane or crosswalk, with bounds as far to either side of a lane."""
    roads, links = wanted.roads, wanted.lane_links
    assert links is not None
    name, kind = int(roads.feature_id[feature]), int(roads.map_type[feature])
    element = Element("lanelet", id=str(name))
    centre = roads.points_of(feature)
    left, right = centre + HALF_WIDTH, centre - HALF_WIDTH
    if kind == MapType.CROSSWALK:
        left, right = roads.points_of(feature)[:2], roads.points_of(feature)[3:1:-1]
    for tag, bound in (("leftBound", left), ("rightBound", right)):
        places(SubElement(element, tag), bound)
    for tag, row, column in (("predecessor", 1, 0), ("successor", 0, 1)):
        for other in links.successor[links.successor[:, row] == name, column]:
            SubElement(element, tag, ref=str(other))
    for other in links.neighbor[links.neighbor[:, 0] == name, 1]:
        SubElement(element, "adjacentLeft", ref=str(other), drivingDir="same")
    SubElement(element, "adjacentRight", ref="99", drivingDir="opposite")
    limit = links.limit[links.limited == name]
    if version == "2018b":
        for value in limit:
            SubElement(element, "speedLimit").text = repr(float(value))
        return element

    SubElement(element[0], "lineMarking").text = "solid"
    words = {**LANE_WORDS, MapType.CROSSWALK: "crosswalk"}
    SubElement(element, "laneletType").text = words[MapType(kind)]
    for sign in links.stop[links.stop[:, 1] == name, 0]:
        SubElement(element, "trafficSignRef", ref=str(sign))
    if len(limit):
        SubElement(element, "trafficSignRef", ref=str(FIRST_LIMIT + name))
    for i in (wanted.lights.lane_id == name).nonzero()[0]:
        SubElement(element, "trafficLightRef", ref=str(FIRST_LIGHT + i))
        across = np.array([0.0, 2.0, 0.0])
        place = wanted.lights.xyz[i]
        places(
            SubElement(element, "stopLine"), np.stack([place - across, place + across])
        )
    return element


def signs(wanted: Scenario) -> list[Element]:
    """Returns the stop signs and one speed limit for each limited lane."""
    roads, links = wanted.roads, wanted.lane_links
    assert links is not None
    found = []
    for i in (roads.map_type == MapType.STOP_SIGN).nonzero()[0]:
        element = sign(int(roads.feature_id[i]), "206", None)
        places(SubElement(element, "position"), roads.points_of(int(i)))
        found.append(element)
    for name, limit in zip(links.limited, links.limit, strict=True):
        found.append(sign(FIRST_LIMIT + int(name), "R2-1", repr(float(limit))))
    return found


def sign(name: int, kind: str, value: str | None) -> Element:
    """Returns a traffic sign of a country's catalogue."""
    element = Element("trafficSign", id=str(name))
    content = SubElement(element, "trafficSignElement")
    SubElement(content, "trafficSignID").text = kind
    if value is not None:
        SubElement(content, "additionalValue").text = value
    return element


def traffic_lights(wanted: Scenario) -> list[Element]:
    """Returns lights whose cycle is all that the scenario saw, begun two steps late."""
    found = []
    for i, states in enumerate(wanted.lights.state.tolist()):
        element = Element("trafficLight", id=str(FIRST_LIGHT + i))
        cycle = SubElement(element, "cycle")
        for state in np.roll(states, -2).tolist():
            part = SubElement(cycle, "cycleElement")
            SubElement(part, "duration").text = "1"
            SubElement(part, "color").text = COLOURS.get(LightState(state), "inactive")
        SubElement(cycle, "timeOffset").text = "2"
        found.append(element)
    return found


def obstacle(wanted: Scenario, index: int, version: str) -> Element:
    """Returns an object, its first valid state as the initial one."""
    tracks = wanted.tracks
    name = {"id": str(tracks.object_id[index])}
    element = Element("dynamicObstacle" if version == "2020a" else "obstacle", name)
    if version == "2018b":
        SubElement(element, "role").text = "dynamic"
    SubElement(element, "type").text = WORDS[ObjectType(tracks.object_type[index])]
    rectangle = SubElement(SubElement(element, "shape"), "rectangle")
    SubElement(rectangle, "length").text = repr(float(tracks.size[index, 0]))
    SubElement(rectangle, "width").text = repr(float(tracks.size[index, 1]))
    first, *rest = tracks.valid[index].nonzero()[0]
    element.append(state(wanted, index, first, "initialState"))
    trajectory = SubElement(element, "trajectory")
    trajectory.extend(state(wanted, index, step, "state") for step in rest)
    return element


def state(wanted: Scenario, index: int, step: int, tag: str) -> Element:
    """Returns a state, its speed told as an interval around the right one."""
    tracks = wanted.tracks
    element = Element(tag)
    places(SubElement(element, "position"), tracks.xyz[index, step][None])
    yaw = float(tracks.yaw[index, step])
    SubElement(SubElement(element, "orientation"), "exact").text = repr(yaw)
    SubElement(SubElement(element, "time"), "exact").text = str(step)
    speed = float(tracks.velocity[index, step] @ [np.cos(yaw), np.sin(yaw)])
    velocity = SubElement(element, "velocity")
    SubElement(velocity, "intervalStart").text = repr(speed - 0.5)
    SubElement(velocity, "intervalEnd").text = repr(speed + 0.5)
    return element


def places(parent: Element, points: np.ndarray) -> None:
    """Adds points to an element."""
    for record in files.records(points):
        point = SubElement(parent, "point")
        for axis, value in record.items():
            SubElement(point, axis).text = repr(value)
