"""Reads the lanelets of CommonRoad as a map: lanes, lines and the edges of the road."""

from xml.etree.ElementTree import Element

from ..scenario import LaneLinks, MapType, Polylines
from . import commonroad_values as values, lane_map
from .commonroad_signs import Signs
from .lane_map import Lane

# Version 2018b has no types; 2020a may give several, of which the first known counts.
_LANE_TYPES = {
    "highway": MapType.LANE_FREEWAY,
    "interstate": MapType.LANE_FREEWAY,
    "mainCarriageWay": MapType.LANE_FREEWAY,
    "accessRamp": MapType.LANE_FREEWAY,
    "exitRamp": MapType.LANE_FREEWAY,
    "urban": MapType.LANE_SURFACE_STREET,
    "country": MapType.LANE_SURFACE_STREET,
    "busLane": MapType.LANE_SURFACE_STREET,
    "driveWay": MapType.LANE_SURFACE_STREET,
    "intersection": MapType.LANE_SURFACE_STREET,
    "bicycleLane": MapType.LANE_BIKE,
}
_CROSSWALK, _SIDEWALK = "crosswalk", "sidewalk"  # areas that vehicles do not follow

# Markings have no colour: they count as white.
_LINE_TYPES = {
    "dashed": MapType.LINE_BROKEN_SINGLE_WHITE,
    "broad_dashed": MapType.LINE_BROKEN_SINGLE_WHITE,
    "solid": MapType.LINE_SOLID_SINGLE_WHITE,
    "broad_solid": MapType.LINE_SOLID_SINGLE_WHITE,
    "solid_solid": MapType.LINE_SOLID_DOUBLE_WHITE,
    "no_marking": None,
}


def lanes(root: Element, signs: Signs) -> list[Lane]:
    """Returns the lanes on which vehicles may drive.

    Raises:
        ScenarioError: if a lanelet is malformed.
    """
    return [
        _lane(lanelet, signs)
        for lanelet in root.iterfind("lanelet")
        if not {_CROSSWALK, _SIDEWALK} & _types(lanelet)
    ]


def roads(root: Element, lanes: list[Lane], signs: Signs) -> Polylines:
    """Returns the features of the map.

    The edges are those of the area that the lanes cover together: a bound that another
    lane shares or crosses, as in a junction or where lanes merge, is none.

    Raises:
        ScenarioError: if a lanelet is malformed, or the lanes too long or tangled.
    """
    others = [
        (MapType.CROSSWALK, crossing.lane_id, crossing.area)
        for crossing in (
            _lane(lanelet, signs)
            for lanelet in root.iterfind("lanelet")
            if _CROSSWALK in _types(lanelet)
        )
    ]
    others += [(MapType.STOP_SIGN, sign, xyz) for sign, xyz in signs.stop_places(lanes)]
    return lane_map.roads(lanes, [lane.area for lane in lanes], others)


def links(lanes: list[Lane], signs: Signs) -> LaneLinks:
    """Returns what ties the lanes to one another and to signs."""
    return lane_map.links(lanes, signs.stops)


def _types(lanelet: Element) -> set[str]:
    return {(kind.text or "").strip() for kind in lanelet.iterfind("laneletType")}


def _lane(lanelet: Element, signs: Signs) -> Lane:
    lane_id = values.integer(lanelet.get("id"), "'id' of a lanelet")
    place = f"lanelet {lane_id}: a bound"
    kinds = (kind.text or "" for kind in lanelet.iterfind("laneletType"))
    known = [_LANE_TYPES[k.strip()] for k in kinds if k.strip() in _LANE_TYPES]
    return Lane(
        lane_id=lane_id,
        kind=known[0] if known else MapType.LANE_UNDEFINED,
        left=values.points(lanelet.find("leftBound"), place),
        right=values.points(lanelet.find("rightBound"), place),
        left_line=_line(lanelet.findtext("leftBound/lineMarking")),
        right_line=_line(lanelet.findtext("rightBound/lineMarking")),
        successors=values.references(lanelet, "successor"),
        predecessors=values.references(lanelet, "predecessor"),
        neighbors=tuple(
            values.integer(beside.get("ref"), f"lanelet {lane_id}: 'ref' of {side}")
            for side in ("adjacentLeft", "adjacentRight")
            for beside in lanelet.iterfind(side)
            if beside.get("drivingDir") == "same"
        ),
        speed_limit=signs.speed_limit(lanelet),
    )


def _line(word: str | None) -> MapType | None:
    """Returns the type of a marking; version 2018b tells of none."""
    return None if word is None else _LINE_TYPES.get(word.strip(), MapType.LINE_UNKNOWN)
