"""Reads scenarios of CommonRoad, XML of the versions 2018b and 2020a."""

import dataclasses
import pathlib
import re
from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from .. import scenario
from ..scenario import ObjectType, Scenario, ScenarioError, Tracks
from . import (
    base,
    commonroad_lights,
    commonroad_map,
    commonroad_signs,
    commonroad_values as values,
    parts,
    xml_tree,
)
from .base import BadRecord, Reader

_NAME = "commonroad"
_HISTORY = 1.0  # seconds up to the current step
_HEAD = re.compile(rb"(?:\xef\xbb\xbf)?\s*<(?:.*?<)??commonRoad\b", re.DOTALL)
_OBSTACLES = ("obstacle", "dynamicObstacle", "staticObstacle")
_MAX_STEP_LENGTH = 10.0  # seconds

_VEHICLES = (
    *("car", "truck", "bus", "motorcycle", "parkedVehicle", "priorityVehicle"),
    "taxi",
)
_OBJECT_TYPES = {
    **dict.fromkeys(_VEHICLES, ObjectType.VEHICLE),
    "bicycle": ObjectType.CYCLIST,
    "pedestrian": ObjectType.PEDESTRIAN,
}

# Metres: obstacles are plane.
_HEIGHTS = {
    ObjectType.VEHICLE: 1.6,
    ObjectType.CYCLIST: 1.8,
    ObjectType.PEDESTRIAN: 1.75,
    ObjectType.OTHER: 1.5,
}
_ASSUMPTIONS = (
    "ego: chosen among the obstacles, as that of the planning problem has no log",
    "heights: one for each kind of object, and places at zero unless told",
    "line markings: white, as the format tells no colour",
    "speed limits on signs: in metres per second, as those of lanelets",
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Obstacle:
    """One obstacle as the file tells it."""

    object_id: int
    kind: ObjectType
    length: float  # metres
    width: float
    states: Float[np.ndarray, "states 6"]  # step, x, y, z, yaw, speed
    stands: bool  # for the whole scenario, as in its only state


def convert(record: bytes) -> Scenario:
    """Makes a scenario of an XML document.

    Numbers given as intervals count as their middle, positions given as shapes as
    their centre. The first step that any obstacle has is step 0.

    Args:
        record: the text.

    Returns:
        The scenario; `scenario.check` has yet to look at it.

    Raises:
        ScenarioError: if the text is no CommonRoad scenario, or its parts contradict
            one another.
    """
    root = xml_tree.parse(record)
    scenario_id = root.get("benchmarkID")
    if root.tag != "commonRoad" or not scenario_id:
        raise ScenarioError("there is no commonRoad with a benchmarkID")
    obstacles = [_obstacle(child) for child in root if child.tag in _OBSTACLES]
    first_step, tracks = _tracks(obstacles)
    dt = _step_length(root)
    ego_index, ego_source = scenario.choose_ego(tracks, None)
    signs = commonroad_signs.read(root)
    lanes = commonroad_map.lanes(root, signs)
    return Scenario(
        scenario_id=scenario_id,
        dataset=_NAME,
        dt=dt,
        current_step=round(_HISTORY / dt),
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=commonroad_map.roads(root, lanes, signs),
        lights=commonroad_lights.read(
            root, lanes, first_step + np.arange(tracks.valid.shape[1])
        ),
        lane_links=commonroad_map.links(lanes, signs),
        assumptions=_ASSUMPTIONS,
    )


def _step_length(root: Element) -> float:
    try:
        seconds = float(root.get("timeStepSize", ""))
    except ValueError:
        seconds = np.nan
    if not 0 < seconds <= _MAX_STEP_LENGTH:
        raise ScenarioError(
            f"timeStepSize must be a length of at most {_MAX_STEP_LENGTH:.0f} s, got "
            f"{root.get('timeStepSize')!r:.40}"
        )
    return seconds


def _obstacle(element: Element) -> _Obstacle:
    object_id = values.integer(element.get("id"), "'id' of an obstacle")
    place = f"obstacle {object_id}"
    role = (element.findtext("role") or element.tag.removesuffix("Obstacle")).strip()
    kind = _OBJECT_TYPES.get((element.findtext("type") or "").strip(), ObjectType.OTHER)
    initial = element.find("initialState")
    if initial is None:
        raise ScenarioError(f"{place} has no initialState")
    states = [initial]
    if role != "static":
        states += element.findall("trajectory/state")
    length, width = _size(element.find("shape"), place)
    return _Obstacle(
        object_id=object_id,
        kind=kind,
        length=length,
        width=width,
        states=_states(states, place),
        stands=role == "static",
    )


def _states(states: list[Element], place: str) -> Float[np.ndarray, "states 6"]:
    """Returns step, position, orientation and speed; what has no speed stands."""
    moves = np.array([state.find("velocity") is not None for state in states])
    moving = [state for state, is_told in zip(states, moves, strict=True) if is_told]
    speed = np.zeros(len(states))
    speed[moves] = values.numbers(moving, "velocity", f"{place}: velocity")
    return np.column_stack(
        [
            values.numbers(states, "time", f"{place}: time"),
            values.centres(states, "position", f"{place}: position"),
            values.numbers(states, "orientation", f"{place}: orientation"),
            speed,
        ]
    )


def _size(shape: Element | None, place: str) -> tuple[float, float]:
    """Returns length and width of the first shape, or of the box around it [m]."""
    place = f"{place}: shape"
    rectangle, circle, polygon = (
        None if shape is None else shape.find(name)
        for name in ("rectangle", "circle", "polygon")
    )
    if rectangle is not None:
        return (
            values.number(rectangle.find("length"), place),
            values.number(rectangle.find("width"), place),
        )
    if circle is not None:
        diameter = 2 * values.number(circle.find("radius"), place)
        return diameter, diameter
    corners = values.points(polygon, place)
    if not len(corners):
        raise ScenarioError(f"{place} has no points")
    length, width, _ = np.ptp(corners, axis=0).tolist()
    return length, width


def _tracks(obstacles: Sequence[_Obstacle]) -> tuple[float, Tracks]:
    """Lays the states out over steps, and returns the file's number of the first."""
    if not obstacles:
        raise ScenarioError("there is no obstacle, so there is no log")
    rows = np.concatenate([item.states for item in obstacles])
    row_object = np.repeat(
        np.arange(len(obstacles)), [len(item.states) for item in obstacles]
    )
    first = rows[:, 0].min()
    step = np.round(rows[:, 0] - first)
    num_steps = step.max() + 1
    if not len(obstacles) * num_steps <= parts.MAX_STATES:
        raise ScenarioError(
            f"{len(obstacles)} obstacles over {num_steps:.0f} steps are more than "
            f"{parts.MAX_STATES} states"
        )
    step = step.astype(np.int64)
    grid = np.zeros((len(obstacles), int(num_steps), 5))
    valid = np.zeros(grid.shape[:2], bool)
    if len(np.unique(row_object * grid.shape[1] + step)) != len(step):
        raise ScenarioError("an obstacle has two states at one step")
    grid[row_object, step] = rows[:, 1:]
    valid[row_object, step] = True
    for i, item in enumerate(obstacles):
        if item.stands:
            grid[i], valid[i] = item.states[0][1:], True
            grid[i, :, 4] = 0.0
    return float(first), Tracks(
        object_id=np.array([item.object_id for item in obstacles], np.int64),
        object_type=np.array([item.kind for item in obstacles], np.int64),
        xyz=grid[..., :3],
        yaw=parts.wrap_angle(grid[..., 3]),
        velocity=grid[..., 4:] * _heading(grid[..., 3]),
        valid=valid,
        size=np.array([[o.length, o.width, _HEIGHTS[o.kind]] for o in obstacles]),
        is_of_interest=np.zeros(len(obstacles), bool),
    )


def _heading(yaw: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)


def _recognizes(head: bytes) -> bool:
    return _HEAD.match(head) is not None


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    try:
        with base.opened(path) as stream:
            record = base.take(stream, xml_tree.MAX_BYTES + 1)
    except ScenarioError as error:
        yield BadRecord(path=path, record_index=0, reason=str(error))
        return
    yield base.outcome(convert, record, path, record_index=0)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
