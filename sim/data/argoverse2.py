"""Reads motion forecasting scenarios of Argoverse 2: a parquet file beside its map."""

import functools
import pathlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from .. import scenario
from ..scenario import LANES, ObjectType, Polylines, Scenario, ScenarioError, Tracks
from . import argoverse2_map, base, parquet, parts
from .base import BadRecord, Reader

_NAME = "argoverse2"
_EGO = "AV"
_SCORED = 2  # the object_category from which tracks are scored; 3 is the focal one
_MAX_FILE_BYTES = 1 << 26
_SAFE_ID = re.compile(r"[\w-]{1,100}")  # it becomes part of a file's name

_TEXTS = ("scenario_id", "track_id", "object_type")
_INTEGERS = ("object_category", "timestep", "observed")
_NUMBERS = ("position_x", "position_y", "heading", "velocity_x", "velocity_y")

# Length, width, height in metres. The data have no sizes: these are common ones of the
# kind, the vehicle's those of a mid-size car.
_SIZES = {
    "vehicle": (ObjectType.VEHICLE, 4.6, 1.9, 1.6),
    "bus": (ObjectType.VEHICLE, 12.0, 2.6, 3.2),
    "motorcyclist": (ObjectType.VEHICLE, 2.2, 0.8, 1.7),
    "cyclist": (ObjectType.CYCLIST, 1.8, 0.7, 1.8),
    "pedestrian": (ObjectType.PEDESTRIAN, 0.7, 0.7, 1.75),
    "riderless_bicycle": (ObjectType.OTHER, 1.8, 0.6, 1.1),
    "static": (ObjectType.OTHER, 1.0, 1.0, 1.0),
    "background": (ObjectType.OTHER, 1.0, 1.0, 1.0),
    "construction": (ObjectType.OTHER, 1.0, 1.0, 1.0),
    "unknown": (ObjectType.OTHER, 1.0, 1.0, 1.0),
}
_ASSUMPTIONS = (
    "sizes: one for each kind of object, as the data set has none",
    "heights: half the size above the nearest point of a lane's centre line",
)


def convert(record: bytes, folder: pathlib.Path) -> Scenario:
    """Makes a scenario of a parquet file and the map in the same folder.

    The current step is the last one that is marked as observed. Numbers that name
    tracks are kept; a track named otherwise, as the AV, gets the least number that is
    free.

    Args:
        record: the parquet file.
        folder: where its map lies.

    Returns:
        The scenario; `scenario.check` has yet to look at it.

    Raises:
        ScenarioError: if the file or its map is missing, damaged or of another kind.
    """
    if len(record) > _MAX_FILE_BYTES:
        raise ScenarioError(
            f"the file is longer than {_MAX_FILE_BYTES} bytes; this is no scenario"
        )
    table = parquet.columns(record, _TEXTS, _INTEGERS, _NUMBERS)
    ids = table["scenario_id"].values
    if len(ids) != 1 or not _SAFE_ID.fullmatch(ids[0]):
        raise ScenarioError(f"scenario_id must be one name, got {ids[:3]!r:.80}")
    roads, lane_links = argoverse2_map.read(folder, ids[0])

    tracks, names = _tracks(table, roads)
    if _EGO not in names:
        raise ScenarioError(f"no track is named {_EGO!r}, the recording vehicle")
    ego_index, ego_source = scenario.choose_ego(tracks, names.index(_EGO))
    observed = table["timestep"][table["observed"] != 0]
    return Scenario(
        scenario_id=ids[0],
        dataset=_NAME,
        current_step=int(observed.max(initial=0)),
        tracks=tracks,
        ego_index=ego_index,
        ego_source=ego_source,
        roads=roads,
        lights=parts.no_lights(tracks.valid.shape[1]),
        lane_links=lane_links,
        assumptions=_ASSUMPTIONS,
    )


def _tracks(table: dict[str, Any], roads: Polylines) -> tuple[Tracks, list[str]]:
    """Lays the rows out as tracks over steps, and tells the tracks' names."""
    track, step = table["track_id"].codes, table["timestep"]
    names = table["track_id"].values
    _check_places(track, step, len(names))
    shape = (len(names), int(step.max()) + 1)

    def laid_out(*columns: str) -> Float[np.ndarray, "objects steps features"]:
        grid = np.zeros((*shape, len(columns)))
        grid[track, step] = np.stack([table[name] for name in columns], axis=-1)
        return grid

    valid = np.zeros(shape, bool)
    valid[track, step] = True
    first = np.unique(track, return_index=True)[1]
    kinds = [table["object_type"].values[i] for i in table["object_type"].codes[first]]
    sizes = np.array([_SIZES.get(kind, _SIZES["unknown"]) for kind in kinds])
    xy = laid_out("position_x", "position_y")
    z = _ground(xy, valid, roads) + sizes[:, None, 3] / 2
    is_of_interest = np.zeros(len(names), bool)
    np.logical_or.at(is_of_interest, track, table["object_category"] >= _SCORED)
    tracks = Tracks(
        object_id=_numbers(names),
        object_type=sizes[:, 0].astype(np.int64),
        xyz=parts.zero_unless(valid, np.concatenate([xy, z[..., None]], axis=-1)),
        yaw=parts.wrap_angle(laid_out("heading")[..., 0]),
        velocity=laid_out("velocity_x", "velocity_y"),
        valid=valid,
        size=sizes[:, 1:],
        is_of_interest=is_of_interest,
    )
    return tracks, names


def _check_places(
    track: Int[np.ndarray, " rows"], step: Int[np.ndarray, " rows"], num_tracks: int
) -> None:
    """Raises ScenarioError unless each row has a place of its own."""
    if step.min() < 0 or num_tracks * (int(step.max()) + 1) > parts.MAX_STATES:
        raise ScenarioError(
            f"{num_tracks} tracks with steps from {step.min()} to {step.max()} are no "
            f"scenario: at most {parts.MAX_STATES} states are read"
        )
    num_places = len(np.unique(track * (int(step.max()) + 1) + step))
    if num_places != len(step):
        raise ScenarioError(
            f"{len(step) - num_places} rows tell of a track and step told before"
        )


def _numbers(names: list[str]) -> Int[np.ndarray, " objects"]:
    """Returns the numbers that tracks are named by; others get those that are free."""
    numbers = [
        int(name) if re.fullmatch(r"0|[1-9][0-9]{0,17}", name) else None
        for name in names
    ]
    taken = set(numbers)
    free = (i for i in range(len(names)) if i not in taken)
    return np.array([next(free) if n is None else n for n in numbers], np.int64)


def _ground(
    xy: Float[np.ndarray, "objects steps 2"],
    valid: Bool[np.ndarray, "objects steps"],
    roads: Polylines,
) -> Float[np.ndarray, "objects steps"]:
    """Returns the height of the nearest point of a lane, 0 where there is none."""
    is_lane = np.repeat(np.isin(roads.map_type, LANES), np.diff(roads.offset))
    lanes, z = roads.xyz[is_lane], np.zeros(valid.shape)
    place = xy[valid]
    is_finite = np.isfinite(place).all(axis=1)  # `scenario.check` names the others
    if len(lanes) and is_finite.any():
        tree = shapely.STRtree(np.asarray(shapely.points(lanes[:, :2])))
        height = np.zeros(len(place))
        nearest = tree.nearest(shapely.points(place[is_finite]))
        height[is_finite] = lanes[nearest, 2]
        z[valid] = height
    return z


def _recognizes(head: bytes) -> bool:
    return head.startswith(parquet.MAGIC) or argoverse2_map.is_map(head)


def _records(path: pathlib.Path) -> Iterator[Scenario | BadRecord]:
    try:
        with base.opened(path) as stream:
            record = base.take(stream, len(parquet.MAGIC))
            if record != parquet.MAGIC:
                return  # a map, which is read with its scenario
            record += base.take(stream, _MAX_FILE_BYTES + 1)
    except ScenarioError as error:
        yield BadRecord(path=path, record_index=0, reason=str(error))
        return
    scene = functools.partial(convert, folder=path.parent)
    yield base.outcome(scene, record, path, record_index=0)


READER = Reader(name=_NAME, recognizes=_recognizes, records=_records)
