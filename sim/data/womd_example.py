"""Reads tf.Examples, the tabular form of WOMD, from TFRecords."""

import dataclasses
import pathlib
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from .. import scenario
from ..scenario import (
    Lights,
    MapType,
    Paths,
    Polylines,
    Scenario,
    ScenarioError,
    Tracks,
)
from . import parts, tfrecord, wire
from .base import BadRecord, Reader

_NAME = "womd_example"
_TENSES = ("past", "current", "future")
_MAX_EXACT_ID = 2**53  # float64 holds every integer up to here


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Features:
    """The features of one tf.Example, decoded when asked for."""

    raw: dict[str, bytes]

    def floats(self, name: str, *shape: int) -> Float[np.ndarray, "..."]:
        """Returns a feature as float64 in a shape, of which one length may be -1."""
        return self._numbers(name, shape).astype(np.float64)

    def integers(self, name: str, *shape: int) -> Int[np.ndarray, "..."]:
        """Returns a feature as int64; WOMD stores some ids and types as floats."""
        values = self._numbers(name, shape)
        is_exact = (values % 1 == 0) & (np.abs(values) < _MAX_EXACT_ID)
        if values.dtype.kind == "f" and not is_exact.all():
            raise ScenarioError(f"feature '{name}' has a value that is no integer")
        return values.astype(np.int64)

    def _numbers(self, name: str, shape: tuple[int, ...]) -> Shaped[np.ndarray, "..."]:
        if name not in self.raw:
            raise ScenarioError(
                f"feature '{name}' is missing: this is no tf.Example of WOMD"
            )
        values = wire.numbers(self.raw[name])
        try:
            return values.reshape(shape)
        except ValueError as error:
            raise ScenarioError(
                f"feature '{name}' has {len(values)} values, which do not fill the "
                f"shape {list(shape)} (-1 is any length)"
            ) from error

    def tenses(self, group: str) -> list[str]:
        """Returns the tenses that are there; a testing split lacks the future."""
        return [
            tense
            for tense in _TENSES
            if tense != "future" or f"{group}/future/valid" in self.raw
        ]


def convert(record: bytes) -> Scenario:
    """Makes a scenario of a tf.Example.

    Rows of padding are left out: objects of no type that are never valid, road points
    and lights that are not valid. Consecutive road points with one id are one map
    feature.

    Args:
        record: the tf.Example as it stands in the file.

    Returns:
        The scenario, without a lane graph; `scenario.check` has yet to look at it.

    Raises:
        ScenarioError: if the bytes are no tf.Example of WOMD, or its features
            contradict one another.
    """
    features = _Features(raw=wire.features(record))
    if "scenario/id" not in features.raw:
        raise ScenarioError(
            "feature 'scenario/id' is missing: this is no tf.Example of WOMD"
        )
    scenario_id = b"".join(wire.texts(features.raw["scenario/id"]))
    num_objects = len(features.integers("state/id", -1))
    current_step = features.integers("state/past/valid", num_objects, -1).shape[1]
    tracks, is_ego = _tracks(features, num_objects, current_step)
    ego_index, ego_source = scenario.choose_ego(
        tracks, int(is_ego.argmax()) if is_ego.any() else None
    )
    return Scenario(
        scenario_id=scenario_id.decode(errors="replace"),
        dataset=_NAME,
        current_step=current_step,
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=_roads(features),
        lights=_lights(features, num_steps=tracks.valid.shape[1]),
        lane_links=None,
        assumptions=(parts.NO_LANE_GRAPH,),
        paths=_paths(features),
    )


def _tracks(
    features: _Features, num_objects: int, current_step: int
) -> tuple[Tracks, Bool[np.ndarray, " objects"]]:
    """Returns the tracks without padding, and which of them is the self-driving car."""
    tenses = features.tenses("state")
    valid = np.concatenate(
        [features.integers(f"state/{t}/valid", num_objects, -1) for t in tenses], axis=1
    )
    valid = valid > 0

    def stacked(*names: str) -> Float[np.ndarray, "objects steps features"]:
        columns = [
            np.concatenate(
                [
                    features.floats(f"state/{tense}/{name}", num_objects, -1)
                    for tense in tenses
                ],
                axis=1,
            )
            for name in names
        ]
        for name, column in zip(names, columns, strict=True):
            if column.shape != valid.shape:
                raise ScenarioError(
                    f"features 'state/*/{name}' have {column.shape[1]} steps and "
                    f"'state/*/valid' have {valid.shape[1]}"
                )
        return parts.zero_unless(valid, np.stack(columns, axis=-1))[kept]

    def marked(name: str) -> Bool[np.ndarray, " objects"]:
        return features.integers(f"state/{name}", num_objects)[kept] > 0

    object_type = features.integers("state/type", num_objects)
    kept = valid.any(axis=1) | (object_type > 0)
    size = stacked("length", "width", "height")
    tracks = Tracks(
        object_id=features.integers("state/id", num_objects)[kept],
        object_type=parts.object_types(object_type[kept]),
        xyz=stacked("x", "y", "z"),
        yaw=parts.wrap_angle(stacked("bbox_yaw")[..., 0]),
        velocity=stacked("velocity_x", "velocity_y"),
        valid=valid[kept],
        size=parts.constant_size(size, valid[kept], current_step),
        is_of_interest=marked("objects_of_interest") | marked("tracks_to_predict"),
    )
    return tracks, marked("is_sdc")


def _roads(features: _Features) -> Polylines:
    point_id = features.integers("roadgraph_samples/id", -1)
    valid = features.integers("roadgraph_samples/valid", len(point_id)) > 0
    point_type = features.integers("roadgraph_samples/type", len(point_id))[valid]
    xyz = features.floats("roadgraph_samples/xyz", len(point_id), 3)[valid]
    point_id = point_id[valid]
    unknown = ~np.isin(point_type, list(MapType))
    if unknown.any():
        raise ScenarioError(
            f"'roadgraph_samples/type' has {point_type[unknown][0]}, which is no "
            "MapType"
        )

    ids_change = np.diff(point_id) != 0
    start = np.flatnonzero(np.concatenate([[len(point_id) > 0], ids_change]))
    return parts.polylines(
        xyz,
        np.diff(np.append(start, len(point_id))),
        point_type[start],
        point_id[start],
    )


def _lights(features: _Features, num_steps: int) -> Lights:
    group = "traffic_light_state"
    tenses = features.tenses(group)
    if f"{group}/current/valid" not in features.raw:
        return parts.no_lights(num_steps)
    num_slots = len(features.integers(f"{group}/current/valid", -1))

    def column(name: str) -> Int[np.ndarray, "steps slots"]:
        rows = [features.integers(f"{group}/{t}/{name}", -1, num_slots) for t in tenses]
        return np.concatenate(rows)

    def place(axis: str) -> Float[np.ndarray, "steps slots"]:
        rows = [features.floats(f"{group}/{t}/{axis}", -1, num_slots) for t in tenses]
        return np.concatenate(rows)

    valid = column("valid") > 0
    lane_id, state = column("id"), column("state")
    xyz = [place(axis) for axis in "xyz"]
    if any(values.shape != valid.shape for values in (lane_id, state, *xyz)):
        raise ScenarioError(
            f"the features '{group}/*' differ in their numbers of steps"
        )
    return parts.lights(
        lane_id=lane_id[valid],
        step=valid.nonzero()[0],
        state=state[valid],
        xyz=np.stack(xyz, axis=-1)[valid],
        valid=valid[valid],
        num_steps=num_steps,
    )


def _paths(features: _Features) -> Paths | None:
    """Reads the routes of the ego, where a record has some: P of M points each."""
    if "path_samples/xyz" not in features.raw:
        return None
    on_route = features.integers("path_samples/on_route", -1) > 0
    valid = features.integers("path_samples/valid", len(on_route), -1) > 0
    xyz = features.floats("path_samples/xyz", *valid.shape, 3)
    if not np.isfinite(xyz[valid]).all():
        raise ScenarioError("'path_samples/xyz' has a value that is not finite")
    kept = valid.any(axis=1)
    if not kept.any():
        return None
    return Paths(
        xyz=xyz[valid],
        offset=np.concatenate([[0], np.cumsum(valid[kept].sum(axis=1))]),
        speed_limit=np.zeros(valid.sum()),
        is_limited=np.zeros(valid.sum(), bool),
        on_route=on_route[kept],
        source="path_samples",
    )


def _recognizes(head: bytes) -> bool:
    payload = tfrecord.first_payload(head)
    return payload is not None and wire.looks_like_example(payload)


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    return tfrecord.scenarios(path, convert)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
