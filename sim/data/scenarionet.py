"""Reads the pickles in which ScenarioNet keeps logs of many sources, one a file."""

import dataclasses
import functools
import pathlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from .. import scenario
from ..scenario import Lights, LightState, ObjectType, Scenario, ScenarioError, Tracks
from . import base, parts, plain_pickle, scenarionet_map
from .base import BadRecord, Reader
from .scenarionet_map import floats, mapping

_NAME = "scenarionet"
_PARTS = ("tracks", "map_features", "metadata")
_OBJECT_TYPES = {member.name: member for member in ObjectType}
_LIGHT_STATES = {f"LANE_STATE_{member.name}": member for member in LightState}
_HISTORY = 1.0  # seconds up to the current step, where the file does not say
_BEYOND_STATES = 1000  # numbers of states; `parts.lights` knows which there are
_MOST_NAMED = 5  # of the words that are not known
_WIDE_EGOS = "nuscenes"  # writes the width of its car as the length in every file
_SIZES = ("length", "width", "height")


def convert(document: Any, fallback_id: str) -> Scenario:
    """Makes a scenario of what a pickle holds.

    Args:
        document: plain data.
        fallback_id: names the scenario where the document does not.

    Returns:
        The scenario; `scenario.check` has yet to look at it.

    Raises:
        ScenarioError: if the data are not those of ScenarioNet.
    """
    for name in _PARTS:
        if not isinstance(document, dict) or not isinstance(document.get(name), dict):
            raise ScenarioError(
                f"there is no mapping '{name}': this is no scenario of ScenarioNet"
            )
        if not document[name]:
            raise ScenarioError(f"the mapping '{name}' is empty")
    metadata, features = document["metadata"], document["map_features"]
    with base.naming("dynamic_map_states"):
        lit = mapping(document.get("dynamic_map_states", {}))
    number = scenarionet_map.numbers(dict.fromkeys(map(str, [*features, *lit])))
    found = scenarionet_map.read_map(features, number)

    dt, assumptions = _step_length(metadata)
    current_step = _current_step(metadata, dt)
    tracks = _tracks(document["tracks"], metadata, current_step, found.is_flat)
    ego_index, ego_source = scenario.choose_ego(
        tracks, _marked(document["tracks"], metadata)
    )
    is_wide = tracks.size[ego_index, 0] < tracks.size[ego_index, 1]
    source = metadata.get("dataset")
    if is_wide and isinstance(source, str) and source == _WIDE_EGOS:
        tracks = _with_ego_turned(tracks, ego_index)
        assumptions += ("length and width of the ego are swapped",)
    scenario_id = document.get("id", fallback_id)
    if not isinstance(scenario_id, str):
        raise ScenarioError(f"'id' must be a text, got a {type(scenario_id).__name__}")
    return Scenario(
        scenario_id=scenario_id,
        dataset=_NAME,
        dt=dt,
        current_step=current_step,
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=found.roads,
        lights=_lights(lit, number, tracks.valid.shape[1]),
        lane_links=found.lane_links,
        assumptions=(*assumptions, *found.assumptions, *_unknown_states(lit)),
    )


def _with_ego_turned(tracks: Tracks, ego_index: int) -> Tracks:
    """Returns the tracks with length and width of the ego swapped."""
    size = tracks.size.copy()
    size[ego_index, :2] = size[ego_index, 1::-1]
    return dataclasses.replace(tracks, size=size)


def _step_length(metadata: dict[Any, Any]) -> tuple[float, tuple[str, ...]]:
    """Returns the time between steps [s], and what had to be assumed."""
    with base.naming("metadata"):
        if metadata.get("ts") is not None:
            times = floats(metadata["ts"])
            if times.ndim != 1:
                raise ValueError("'ts' is no list of times")
            return parts.step_length(times.tolist()), ()
        if metadata.get("sample_rate") is not None:  # the name is odd: it is a time
            rate = floats([metadata["sample_rate"]])[0]
            return parts.step_length([0.0, float(rate)]), ()
    return scenario.DT, (f"steps of {scenario.DT} s",)


def _current_step(metadata: dict[Any, Any], dt: float) -> int:
    step = metadata.get("current_time_index")
    if step is None:
        return round(_HISTORY / dt)
    if type(step) is not int or step < 0:
        raise ScenarioError(
            "metadata is malformed: 'current_time_index' must be a number of a step, "
            f"got {step if type(step) is int else type(step).__name__}"
        )
    return step


def _marked(tracks: dict[Any, Any], metadata: dict[Any, Any]) -> int | None:
    """Returns the index of the track that the file marks as its own car."""
    ego = metadata.get("sdc_id")
    if ego is None:
        return None
    names = [str(name) for name in tracks]
    if not isinstance(ego, str | int) or str(ego) not in names:
        shown = repr(ego)[:40] if isinstance(ego, str | int) else type(ego).__name__
        raise ScenarioError(f"the ego is marked as {shown}, which is no track")
    return names.index(str(ego))


def _tracks(
    tracks: dict[Any, Any], metadata: dict[Any, Any], current_step: int, is_flat: bool
) -> Tracks:
    number = scenarionet_map.numbers(dict.fromkeys(map(str, tracks)))
    if len(number) < len(tracks):
        raise ScenarioError("two tracks have the same name, once as a number")
    rows: list[_Row] = []
    for name, track in tracks.items():
        with base.naming(f"tracks[{str(name)[:40]!r}]"):
            rows.append(_row(track))
            num_steps = [len(row[-1]) for row in (rows[0], rows[-1])]
            if num_steps[0] != num_steps[1]:
                raise ValueError(f"it has {num_steps[1]} steps, others {num_steps[0]}")
            num_states = len(tracks) * num_steps[0]
            parts.require_few(num_states, parts.MAX_STATES, "states of tracks")
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    object_type, xyz, yaw, velocity, size, valid = columns
    xyz = xyz * [1.0, 1.0, 0.0] if is_flat else xyz
    object_id = np.array(list(number.values()), np.int64)
    with base.naming("metadata"):
        named = [*_listed(metadata, "objects_of_interest")]
        named += _listed(metadata, "tracks_to_predict")
        interesting = [number[name] for name in named if name in number]
    return Tracks(
        object_id=object_id,
        object_type=object_type,
        xyz=parts.zero_unless(valid, xyz),
        yaw=parts.wrap_angle(parts.zero_unless(valid, yaw)[..., 0]),
        velocity=parts.zero_unless(valid, velocity),
        valid=valid,
        size=parts.constant_size(size, valid, current_step),
        is_of_interest=parts.of_interest(object_id, interesting, []),
    )


_Row = tuple[
    int,
    Float[np.ndarray, "steps 3"],
    Float[np.ndarray, "steps 1"],
    Float[np.ndarray, "steps 2"],
    Float[np.ndarray, "steps 3"],
    Bool[np.ndarray, " steps"],
]


def _row(track: Any) -> _Row:
    """Returns type, place, heading, velocity, size and validity of a track."""
    state, kind = mapping(mapping(track)["state"]), track["type"]
    valid = floats(state["valid"])
    if valid.ndim != 1:
        raise ValueError(f"'valid' has {valid.ndim} dimensions, not one")

    def column(name: str, width: int) -> Float[np.ndarray, "steps width"]:
        values = floats(state[name])
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) != len(valid) or values.shape[1] < width:
            raise ValueError(
                f"'{name}' has the shape {values.shape}, and [{len(valid)}, {width}] "
                "is needed"
            )
        return values[:, :width]

    sizes = [column(name, 1) for name in _SIZES] if "size" not in state else []
    size = np.concatenate(sizes, axis=1) if sizes else column("size", 3)
    if not isinstance(kind, str):
        raise TypeError(f"its type is a {type(kind).__name__}")
    return (
        int(_OBJECT_TYPES.get(kind, ObjectType.OTHER)),
        column("position", 3),
        column("heading", 1),
        column("velocity", 2),
        size,
        valid > 0,
    )


def _listed(metadata: dict[Any, Any], field: str) -> list[str]:
    """Returns the names of tracks in a list, or of those by which a mapping goes."""
    entries = metadata.get(field)
    if entries is None:
        return []
    if isinstance(entries, list) and any(isinstance(entry, dict) for entry in entries):
        entries = [entry["track_id"] for entry in entries]
    if not isinstance(entries, list | tuple | dict):
        raise TypeError(f"'{field}' is a {type(entries).__name__}")
    return [str(entry) for entry in entries if isinstance(entry, str | int)]


def _lights(lit: dict[Any, Any], number: dict[str, int], num_steps: int) -> Lights:
    """Gathers the lights, each the light of the lane by which it is named."""
    columns = [(np.zeros(0, np.int64),) * 3 + (np.zeros((0, 3)), np.zeros(0, bool))]
    for name, light in lit.items():
        with base.naming(f"dynamic_map_states[{str(name)[:40]!r}]"):
            told = mapping(mapping(light)["state"])
            state, is_told = _light_states(told["object_state"])
            place = told.get("stop_point", light.get("stop_point"))
            xyz = np.zeros((len(state), 3))
            xyz[:] = 0.0 if place is None else floats(place)
            # Older files have a place for each step, of zeros where nothing was seen.
            is_told = is_told & (xyz != 0).any(axis=1)
            lane = np.full(len(state), number[str(name)])
            columns.append((lane, np.arange(len(state)), state, xyz, is_told))
    lane_id, step, state, xyz, is_told = map(np.concatenate, zip(*columns, strict=True))
    return parts.lights(
        lane_id=lane_id,
        step=step,
        state=state,
        xyz=xyz,
        valid=is_told,
        num_steps=num_steps,
    )


def _light_states(
    states: Any,
) -> tuple[Int[np.ndarray, " steps"], Bool[np.ndarray, " steps"]]:
    """Returns what a light shows, told as words or numbers, and where it is told."""
    if isinstance(states, np.ndarray):
        states = states.astype(np.int64) if states.dtype.kind in "biuf" else states
        states = states.tolist()
    if not isinstance(states, list):
        raise TypeError(f"'object_state' is a {type(states).__name__}")
    shown = [
        _LIGHT_STATES.get(state, LightState.UNKNOWN)
        if isinstance(state, str)
        else state
        for state in states
    ]
    known = [s if isinstance(s, int) and abs(s) < _BEYOND_STATES else 0 for s in shown]
    is_told = [state is not None for state in states]
    return np.array(known, np.int64), np.array(is_told, bool)


def _unknown_states(lit: dict[Any, Any]) -> list[str]:
    """Says which words for what lights show are not known."""
    words = {
        word
        for light in lit.values()
        for word in light["state"]["object_state"]
        if isinstance(word, str) and word not in _LIGHT_STATES
    }
    return [f"light unknown: {word[:40]}" for word in sorted(words)[:_MOST_NAMED]]


def _is_index(document: Any) -> bool:
    """Whether a document says what files there are, as those beside a data set do."""
    return (
        isinstance(document, dict)
        and bool(document)
        and all(isinstance(name, str) and name.endswith(".pkl") for name in document)
    )


def _recognizes(head: bytes) -> bool:
    return plain_pickle.looks_like_pickle(head)


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    fallback_id = path.name.removesuffix(".gz").removesuffix(".pkl")
    try:
        document = plain_pickle.loads(base.whole(path))
    except ScenarioError as error:
        yield BadRecord(path=path, record_index=0, reason=str(error))
        return
    if not _is_index(document):
        scene = functools.partial(convert, fallback_id=fallback_id)
        yield base.outcome(scene, document, path, record_index=0)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
