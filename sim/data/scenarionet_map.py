"""Makes map and lane links of the map features that ScenarioNet writes."""

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..scenario import LANES, LaneLinks, MapType, Polylines
from . import base, parts

_SPELLED_BY_WOMD = (
    *(MapType.LANE_FREEWAY, MapType.LANE_SURFACE_STREET, MapType.STOP_SIGN),
    *(MapType.CROSSWALK, MapType.SPEED_BUMP, MapType.DRIVEWAY),
)
_KINDS = {
    "LANE_UNKNOWN": MapType.LANE_UNDEFINED,
    "LANE_BIKE_LANE": MapType.LANE_BIKE,
    "LANE_SURFACE_UNSTRUCTURE": MapType.LANE_SURFACE_STREET,  # lanes inside junctions
    "CROSS_WALK": MapType.CROSSWALK,
    **{kind.name: kind for kind in _SPELLED_BY_WOMD},
    **{
        f"ROAD_{kind.name}": kind
        for kind in MapType
        if MapType.LINE_UNKNOWN <= kind <= MapType.EDGE_MEDIAN
    },
}
# Where a feature has its points; the first that is there counts.
_PLACES = ("polyline", "polygon", "position")
_BOUNDARY = "boundary"  # begins the ids of the outlines of the drivable area
_SAME_POINT = 0.01  # metres between the ends of a ring
_GRAPH = ("entry_lanes", "exit_lanes")
_LIMITS = {"speed_limit_kmh": parts.KMH, "speed_limit_mph": parts.MPH}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Map:
    """What the map features say."""

    roads: Polylines
    lane_links: LaneLinks | None  # None where lanes do not name one another
    is_flat: bool  # has no heights
    assumptions: tuple[str, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Feature:
    name: str
    kind: MapType
    points: Float[np.ndarray, "points axes"]
    content: dict[str, Any]


def floats(values: Any) -> Float[np.ndarray, "*shape"]:
    """Returns numbers in an array, a list or a list of equally long rows.

    Raises:
        TypeError: if there are other values than numbers.
        ValueError: if rows differ in length.
    """
    if isinstance(values, np.ndarray):
        if values.dtype.kind not in "biuf":
            raise TypeError(f"an array of {values.dtype} where numbers belong")
        return values.astype(np.float64)
    if not isinstance(values, list | tuple):
        raise TypeError(f"a {type(values).__name__} where a list of numbers belongs")
    if not values or not isinstance(values[0], list | tuple | np.ndarray):
        return _flat(values)
    if len({len(row) for row in values}) > 1:
        raise ValueError("rows of different lengths")
    if all(isinstance(row, np.ndarray) for row in values):
        return floats(np.stack(values))
    return _flat([*itertools.chain.from_iterable(values)]).reshape(len(values), -1)


def _flat(values: Sequence[Any]) -> Float[np.ndarray, " values"]:
    kinds = set(map(type, values)) - {int, float, bool}
    if kinds:
        raise TypeError(f"a {kinds.pop().__name__} where a number belongs")
    return np.array(values, np.float64)


def mapping(value: Any) -> dict[Any, Any]:
    """Returns a value that is a mapping.

    Raises:
        TypeError: if it is none.
    """
    if not isinstance(value, dict):
        raise TypeError(f"a {type(value).__name__} where a mapping belongs")
    return value


def numbers(names: Iterable[str]) -> dict[str, int]:
    """Returns a number for each name: what it spells if all spell one, else its place.

    ScenarioNet names things by texts, for WOMD by the texts of its numbers.
    """
    names = list(names)
    if all(name.isdecimal() and name.isascii() and len(name) < 19 for name in names):
        spelled = [int(name) for name in names]
        if len(set(spelled)) == len(spelled):
            return dict(zip(names, spelled, strict=True))
    return {name: place for place, name in enumerate(names)}


def read_map(features: dict[Any, Any], number: dict[str, int]) -> Map:
    """Makes the map.

    Where no feature is a road edge, the outlines of the drivable area are: ScenarioNet
    writes them for nuScenes as lines that are rings, with the road on their right.

    Args:
        features: the features by name.
        number: the number of each name.

    Raises:
        ScenarioError: if a feature is malformed.
    """
    found, left_out = [], set()
    for name, content in features.items():
        with base.naming(f"map_features[{str(name)[:40]!r}]"):
            kind = mapping(content)["type"]
            if type(kind) is not str:
                raise TypeError(f"its type is a {type(kind).__name__}")
            if kind in _KINDS:
                found.append(_feature(str(name), _KINDS[kind], content))
            else:
                left_out.add(kind[:40])
    assumptions = [f"left out of the map: {kind}" for kind in sorted(left_out)[:5]]

    # Where some features have two columns, the third of others is a heading.
    is_flat = any(feature.points.shape[1] == 2 for feature in found)
    if is_flat:
        assumptions.append("no heights")
    if not any(MapType.EDGE_UNKNOWN <= f.kind <= MapType.EDGE_MEDIAN for f in found):
        outlined = [_as_edge(feature) for feature in found]
        has_edges = any(f.kind == MapType.EDGE_BOUNDARY for f in outlined)
        source = "from outlines of the drivable area" if has_edges else "none"
        assumptions.append(f"road edges: {source}")
        found = outlined
    links = _lane_links(found, number)
    if links is None:
        assumptions.append(parts.NO_LANE_GRAPH)
    return Map(
        roads=_polylines(found, number, is_flat),
        lane_links=links,
        is_flat=is_flat,
        assumptions=tuple(assumptions),
    )


def _feature(name: str, kind: MapType, content: dict[str, Any]) -> _Feature:
    place = next((place for place in _PLACES if place in content), _PLACES[0])
    points = floats(content[place])
    points = points.reshape(1, -1) if points.ndim == 1 and len(points) else points
    if points.size and (points.ndim != 2 or points.shape[1] not in (2, 3)):
        raise ValueError(
            f"'{place}' has the shape {points.shape}, not [n, 2] or [n, 3]"
        )
    if not points.size:
        points = np.zeros((0, 3))
    return _Feature(name=name, kind=kind, points=points, content=content)


def _as_edge(feature: _Feature) -> _Feature:
    """Returns an outline of the drivable area as the edge of a road on its left."""
    points = feature.points
    is_line = MapType.LINE_UNKNOWN <= feature.kind <= MapType.LINE_PASSING_DOUBLE_YELLOW
    if not (is_line and feature.name.startswith(_BOUNDARY) and len(points) > 3):
        return feature
    if not np.abs(points[0] - points[-1]).max() < _SAME_POINT:
        return feature
    return dataclasses.replace(
        feature, kind=MapType.EDGE_BOUNDARY, points=points[::-1].copy()
    )


def _polylines(
    features: list[_Feature], number: dict[str, int], is_flat: bool
) -> Polylines:
    counts = [len(feature.points) for feature in features]
    xyz = np.zeros((sum(counts), 3))
    used = 2 if is_flat else 3
    if features:
        xyz[:, :used] = np.concatenate([f.points[:, :used] for f in features])
    return parts.polylines(
        xyz,
        np.array(counts, np.int64),
        np.array([feature.kind for feature in features], np.int64),
        np.array([number[feature.name] for feature in features], np.int64),
    )


def _lane_links(features: list[_Feature], number: dict[str, int]) -> LaneLinks | None:
    """Returns what features say of one another; None if they have no place for it."""
    if not any(field in f.content for f in features for field in _GRAPH):
        return None
    successor, neighbor, stop, limits = [], [], [], {}
    for feature in features:
        own, content = number[feature.name], feature.content
        with base.naming(f"map_features[{feature.name[:40]!r}]"):
            if feature.kind == MapType.STOP_SIGN:
                stop += [(own, lane) for lane in _named(content, "lane", number)]
            if feature.kind not in LANES:
                continue
            after = _named(content, "exit_lanes", number)
            successor += [(own, lane) for lane in after]
            before = _named(content, "entry_lanes", number)
            successor += [(lane, own) for lane in before]
            for side in ("left_neighbor", "right_neighbor"):
                neighbor += [(own, lane) for lane in _named(content, side, number)]
            for field, unit in _LIMITS.items():
                if content.get(field) is not None and own not in limits:
                    limits[own] = float(floats([content[field]])[0]) * unit
    return parts.lane_links(successor, neighbor, stop, limits)


def _named(content: dict[str, Any], field: str, number: dict[str, int]) -> list[int]:
    """Returns the numbers of the features that a field names, of those that there are.

    The field lists names, numbers, or mappings with the name.
    """
    names, entries = [], content.get(field)
    if entries is None:
        return []
    if not isinstance(entries, list | tuple | np.ndarray):
        raise TypeError(f"'{field}' is a {type(entries).__name__}")
    for entry in entries.tolist() if isinstance(entries, np.ndarray) else entries:
        name = entry["feature_id"] if isinstance(entry, dict) else entry
        if type(name) is not str and type(name) is not int:
            raise TypeError(f"'{field}' names a {type(name).__name__}")
        names.append(str(name))
    return [number[name] for name in names if name in number]
