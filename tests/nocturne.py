"""Reads Nocturne's two scenes, and what the published program made of them."""

import dataclasses
import functools

import numpy as np
import pytest

from drivetrain.sim.data import build as readers, routes
from drivetrain.sim.scenario import ObjectType, Scenario
from tests import worlds

ORACLE = worlds.REAL_DATA.parent / "oracles/nocturne"
FILES = {
    "example": "example_scenario.json.gz",
    "large": "large_file_tfrecord.json.gz",
}
SCENES = tuple(FILES)


@functools.cache
def scenario(scene: str) -> Scenario:
    """Returns a scene as Nocturne has it: the vehicles that are there at t = 0.

    Objects are named by its numbers: it counts all that are there at t = 0. Skips
    without files.
    """
    path = worlds.REAL_DATA / "nocturne" / FILES[scene]
    if not (path.exists() and ORACLE.exists()):
        pytest.skip("the scenes and the oracle of Nocturne in ../shared are not here")
    read = next(iter(readers.read(path)))
    assert isinstance(read, Scenario)
    tracks = read.tracks
    is_here = tracks.valid[:, 0]
    kept = np.flatnonzero(is_here & (tracks.object_type == ObjectType.VEHICLE))
    columns = {
        f.name: getattr(tracks, f.name)[kept] for f in dataclasses.fields(tracks)
    }
    columns["object_id"] = (np.cumsum(is_here) - 1)[kept]
    ego_index = int(np.flatnonzero(kept == read.ego_index)[0])
    tracks = dataclasses.replace(tracks, **columns)
    return routes.with_paths(
        dataclasses.replace(read, tracks=tracks, ego_index=ego_index)
    )


def oracle(name: str) -> dict[str, np.ndarray]:
    """Returns the arrays of one of the oracle's files, by its name.

    Skips without them.
    """
    path = ORACLE / f"{name}.npz"
    if not path.exists():
        pytest.skip("the oracle of Nocturne in ../shared is not here")
    with np.load(path) as arrays:
        return dict(arrays)


def rows_of(scene: str, ids: np.ndarray) -> np.ndarray:
    """Returns where the bank keeps objects."""
    object_id = worlds.exact(scenario(scene)).object_id
    return np.array([np.flatnonzero(object_id == i)[0] for i in ids])
