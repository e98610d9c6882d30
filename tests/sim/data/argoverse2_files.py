"""Writes scenarios as Argoverse 2 has them: a parquet file with its map beside it.

The format carries less than a scenario: see `as_told` for what comes back.
"""

import dataclasses
import io
import pathlib
from typing import Any

import numpy as np
import orjson
import pyarrow
from pyarrow import parquet

from drivetrain.sim.scenario import LANES, MapType, ObjectType, Scenario
from tests.sim.data import files

LOG = "log"  # the name of the parquet file, which may be any
HALF_WIDTH = np.array([0.0, 1.5, 0.0])  # from the centre line to the bounds [m]
MARGIN = 10.0  # metres of drivable area around the lanes
WORDS = {
    ObjectType.VEHICLE: "vehicle",
    ObjectType.PEDESTRIAN: "pedestrian",
    ObjectType.CYCLIST: "cyclist",
    ObjectType.OTHER: "unknown",
}


def write(wanted: Scenario, folder: pathlib.Path) -> pathlib.Path:
    """Writes a scenario and its map; returns the file to read."""
    made = contents(wanted)
    path = folder / f"scenario_{wanted.scenario_id}.parquet"
    path.write_bytes(made.pop(LOG))
    for name, content in made.items():
        (folder / name).write_bytes(content)
    return path


def contents(wanted: Scenario) -> dict[str, bytes]:
    """Returns the two files by name."""
    return dump(document(wanted))


def document(wanted: Scenario) -> dict[str, Any]:
    """Returns what the two files tell: columns, and a tree."""
    told = {
        name: np.asarray(column).tolist() for name, column in columns(wanted).items()
    }
    return {LOG: told, map_name(wanted): map_document(wanted)}


def dump(document: dict[str, Any]) -> dict[str, bytes]:
    """Encodes what files tell, columns and values of any kind as texts."""
    return {
        name: _any_table(told) if name == LOG else orjson.dumps(told, default=str)
        for name, told in document.items()
    }


def _any_table(told: Any) -> bytes:
    columns = told if isinstance(told, dict) else {"x": told}
    columns = {
        name: column if isinstance(column, list) else [column]
        for name, column in columns.items()
    }
    num_rows = max(map(len, columns.values()), default=0)
    made = {}
    for name, column in columns.items():
        rows = column + [None] * (num_rows - len(column))
        try:
            made[name] = pyarrow.array(rows)
            table({name: made[name]})
        except (pyarrow.ArrowException, OverflowError):  # of more than one kind
            made[name] = [str(value) for value in rows]
    return table(made)


def map_name(wanted: Scenario) -> str:
    """Returns the name that the file of the map must have."""
    return f"log_map_archive_{wanted.scenario_id}.json"


def table(columns: dict[str, Any], **options: Any) -> bytes:
    """Encodes columns as parquet."""
    stream = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), stream, **options)
    return stream.getvalue()


def as_told(wanted: Scenario) -> Scenario:
    """Returns the scenario with the ego named 0, as a track named AV has no number."""
    tracks = wanted.tracks
    object_id = tracks.object_id.copy()
    object_id[wanted.ego_index] = 0
    return dataclasses.replace(
        wanted,
        tracks=dataclasses.replace(tracks, object_id=object_id),
    )


def columns(wanted: Scenario) -> dict[str, Any]:
    """Returns the columns of the parquet file, one row for each valid state."""
    tracks = wanted.tracks
    track, step = tracks.valid.nonzero()
    names = [str(name) for name in tracks.object_id]
    names[wanted.ego_index] = "AV"
    return {
        "observed": step <= wanted.current_step,
        "track_id": [names[i] for i in track],
        "object_type": [WORDS[ObjectType(tracks.object_type[i])] for i in track],
        "object_category": np.where(tracks.is_of_interest[track], 2, 0),
        "timestep": step,
        "position_x": tracks.xyz[track, step, 0],
        "position_y": tracks.xyz[track, step, 1],
        "heading": tracks.yaw[track, step],
        "velocity_x": tracks.velocity[track, step, 0],
        "velocity_y": tracks.velocity[track, step, 1],
        "scenario_id": [wanted.scenario_id] * len(track),
        "city": ["nowhere"] * len(track),
    }


def map_document(wanted: Scenario) -> dict[str, Any]:
    """Returns the map: the lanes, the crosswalks, and one area around the lanes."""
    roads = wanted.roads
    kinds = roads.map_type.tolist()
    lanes = [i for i, kind in enumerate(kinds) if kind in LANES]
    crossings = [i for i, kind in enumerate(kinds) if kind == MapType.CROSSWALK]
    return {
        "lane_segments": {str(roads.feature_id[i]): segment(wanted, i) for i in lanes},
        "pedestrian_crossings": {
            str(roads.feature_id[i]): {
                "id": int(roads.feature_id[i]),
                "edge1": files.records(files.open_run(roads, i)[:2]),
                "edge2": files.records(files.open_run(roads, i)[:1:-1]),
            }
            for i in crossings
        },
        "drivable_areas": {
            "7": {"id": 7, "area_boundary": files.records(area(wanted, lanes))}
        },
    }


def segment(wanted: Scenario, feature: int) -> dict[str, Any]:
    """Returns a lane, with bounds that lie as far to either side of it."""
    roads, links = wanted.roads, wanted.lane_links
    assert links is not None
    name, centre = int(roads.feature_id[feature]), roads.points_of(feature)
    is_bike = roads.map_type[feature] == MapType.LANE_BIKE
    beside = links.neighbor[links.neighbor[:, 0] == name, 1].tolist()
    return {
        "id": name,
        "lane_type": "BIKE" if is_bike else "VEHICLE",
        "is_intersection": False,
        "centerline": [],
        "left_lane_boundary": files.records(centre + HALF_WIDTH),
        "right_lane_boundary": files.records(centre - HALF_WIDTH),
        "left_lane_mark_type": "DOUBLE_SOLID_YELLOW",
        "right_lane_mark_type": "NONE",
        "successors": links.successor[links.successor[:, 0] == name, 1].tolist(),
        "predecessors": links.successor[links.successor[:, 1] == name, 0].tolist(),
        "left_neighbor_id": beside[0] if beside else None,
        "right_neighbor_id": None,
    }


def area(wanted: Scenario, lanes: list[int]) -> np.ndarray:
    """Returns the corners of a rectangle around the lanes."""
    points = np.concatenate([wanted.roads.points_of(i) for i in lanes])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    corners = [(low[0], low[1]), (low[0], high[1]), (high[0], high[1])]
    corners.append((high[0], low[1]))
    return np.array([(x, y, 0.0) for x, y in corners])
