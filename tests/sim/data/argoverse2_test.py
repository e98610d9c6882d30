"""Tests of the reader of Argoverse 2."""

import gzip
import pathlib
import sys
from typing import Any

import numpy as np
import orjson
import pyarrow
import pytest
from pyarrow import parquet

from drivetrain.sim import scenario
from drivetrain.sim.data import build, routes
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import EDGES, MapType, ObjectType, Scenario
from tests.oracles import metrics
from tests.sim.data import argoverse2_files, files

REAL_FILES = sorted((files.REAL_DATA / "argoverse2").glob("*/*.parquet"))
needs_real_files = pytest.mark.skipif(not REAL_FILES, reason=files.NO_REAL_DATA)

EXACT = 1e-12  # metres: float64, means and shares of coordinates of some 100 m
MEDIAN_STEP_ERROR = 0.05  # metres in a step, against the mean of two velocities: the
# data set smooths both, and a car gains as much in a step at 5 m/s^2
SPACING = 1.0 + EXACT  # metres between the points of centre lines, at most


def read(path: pathlib.Path) -> Scenario:
    """Reads the only scenario of a file."""
    (found,) = build.read(path)
    assert isinstance(found, Scenario), found
    return found


def reason(path: pathlib.Path) -> str:
    """Returns why the only record of a file cannot be used."""
    (bad,) = build.read(path)
    assert isinstance(bad, BadRecord)
    return bad.reason


def rewritten(folder: pathlib.Path, **changed: Any) -> pathlib.Path:
    """Writes a scenario with some columns replaced, left out where None."""
    path = argoverse2_files.write(files.scenario(), folder)
    columns = {**argoverse2_files.columns(files.scenario()), **changed}
    columns = {name: column for name, column in columns.items() if column is not None}
    parquet.write_table(pyarrow.table(columns), path)
    return path


@pytest.fixture(scope="module")
def real() -> Scenario:
    """Returns the real scenario."""
    return read(REAL_FILES[0])


def test_lanes_come_back_between_their_bounds(tmp_path: pathlib.Path) -> None:
    wanted = files.scenario()
    found = read(argoverse2_files.write(wanted, tmp_path))
    for lane in range(3):
        name = wanted.roads.feature_id[lane]
        row = int((found.roads.feature_id == name).argmax())
        points = found.roads.points_of(row)
        line = wanted.roads.points_of(lane)
        assert np.allclose(points[[0, -1]], line[[0, -1]], rtol=0, atol=EXACT)
        assert distances(points, line).max() < EXACT
    assert found.lane_links is not None
    assert wanted.lane_links is not None
    assert np.array_equal(found.lane_links.successor, wanted.lane_links.successor)


def distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Returns how far points are from a polyline, in the plane."""
    start, along = line[:-1, :2], np.diff(line[:, :2], axis=0)
    offset = points[:, None, :2] - start
    share = (offset * along).sum(-1) / (along**2).sum(-1)
    rest = offset - np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(rest, axis=-1).min(axis=1)


def test_lanes_are_for_vehicles_or_bikes(tmp_path: pathlib.Path) -> None:
    found = read(argoverse2_files.write(files.scenario(), tmp_path))
    street, bike = MapType.LANE_SURFACE_STREET, MapType.LANE_BIKE
    assert files.scenario().roads.map_type[:3].tolist() == [street, 1, bike]
    assert found.roads.map_type[:3].tolist() == [street, street, bike]


def test_a_crosswalk_comes_back_closed(tmp_path: pathlib.Path) -> None:
    wanted = files.scenario()
    found = read(argoverse2_files.write(wanted, tmp_path))
    ring, wanted_ring = (
        item.roads.points_of(int((item.roads.map_type == MapType.CROSSWALK).argmax()))
        for item in (found, wanted)
    )
    assert sorted(ring[:-1].tolist()) == sorted(wanted_ring[:-1].tolist())
    assert np.array_equal(ring[0], ring[-1])


def test_objects_stand_on_the_nearest_lane(tmp_path: pathlib.Path) -> None:
    found = read(argoverse2_files.write(files.scenario(), tmp_path))
    lanes = np.concatenate([found.roads.points_of(i) for i in range(3)])
    bottom = found.tracks.xyz[..., 2] - found.tracks.size[:, None, 2] / 2
    for i, step in np.argwhere(found.tracks.valid)[::7]:
        gap = lanes[:, :2] - found.tracks.xyz[i, step, :2]
        nearest = np.linalg.norm(gap, axis=1).argmin()
        assert abs(bottom[i, step] - lanes[nearest, 2]) < EXACT


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("bus", ObjectType.VEHICLE),
        ("motorcyclist", ObjectType.VEHICLE),
        ("cyclist", ObjectType.CYCLIST),
        ("riderless_bicycle", ObjectType.OTHER),
        ("background", ObjectType.OTHER),
        ("spaceship", ObjectType.OTHER),
    ],
)
def test_words_for_objects_are_known(
    tmp_path: pathlib.Path, word: str, kind: ObjectType
) -> None:
    num_rows = int(files.scenario().tracks.valid.sum())
    found = read(rewritten(tmp_path, object_type=[word] * num_rows))
    assert set(found.tracks.object_type) == {kind}
    assert (found.tracks.size > 0).all()


def test_a_file_and_its_map_may_be_gzip(tmp_path: pathlib.Path) -> None:
    path = argoverse2_files.write(files.scenario(), tmp_path)
    plain = read(path)
    path.write_bytes(gzip.compress(path.read_bytes()))
    (archive,) = tmp_path.glob("*.json")
    (tmp_path / f"{archive.name}.gz").write_bytes(gzip.compress(archive.read_bytes()))
    archive.unlink()
    assert files.differences(read(path), plain) == []


def test_a_map_that_a_pattern_finds_yields_nothing(tmp_path: pathlib.Path) -> None:
    argoverse2_files.write(files.scenario(), tmp_path)
    (archive,) = tmp_path.glob("*.json")
    assert list(build.read(archive)) == []


def test_a_missing_map_is_named(tmp_path: pathlib.Path) -> None:
    path = argoverse2_files.write(files.scenario(), tmp_path)
    (archive,) = tmp_path.glob("*.json")
    archive.unlink()
    assert f"its map {archive.name} is not beside the parquet file" in reason(path)


NUM_ROWS = int(files.scenario().tracks.valid.sum())


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"heading": None}, "there is no column 'heading'"),
        ({"track_id": ["1"] * NUM_ROWS}, "rows tell of a track and step told before"),
        (
            {"track_id": [str(i) for i in range(NUM_ROWS)]},
            "no track is named 'AV'",
        ),
        ({"timestep": np.arange(NUM_ROWS) - 1}, "with steps from -1 to"),
        ({"timestep": np.arange(NUM_ROWS) * 2**40}, "at most 1048576 states are read"),
        ({"scenario_id": ["../secret"] * NUM_ROWS}, "scenario_id must be one name"),
        ({"scenario_id": [str(i) for i in range(NUM_ROWS)]}, "must be one name"),
        ({"position_x": [None] * NUM_ROWS}, "column 'position_x' has empty places"),
        ({"position_x": ["x"] * NUM_ROWS}, "the parquet data are damaged"),
        ({"observed": np.ones(NUM_ROWS, bool)}, "too short"),
    ],
)
def test_what_is_wrong_with_columns_is_named(
    tmp_path: pathlib.Path, changed: dict[str, Any], sentence: str
) -> None:
    assert sentence in reason(rewritten(tmp_path, **changed))


def test_names_that_are_no_numbers_get_free_ones(tmp_path: pathlib.Path) -> None:
    names = argoverse2_files.columns(files.scenario())["track_id"]
    new = dict(zip(dict.fromkeys(names), ("1", "01", "0", "x", "AV"), strict=True))
    plain = [new[name] for name in names]
    found = read(rewritten(tmp_path, track_id=plain))
    assert found.tracks.object_id.tolist() == [1, 2, 0, 3, 4]


@needs_real_files
def test_the_real_file_holds_what_a_plain_reader_finds(real: Scenario) -> None:
    rows = parquet.read_table(REAL_FILES[0]).to_pylist()
    (archive,) = REAL_FILES[0].parent.glob("*.json")
    document = orjson.loads(archive.read_bytes())
    assert real.tracks.valid.sum() == len(rows)
    assert len(real.tracks.object_id) == len({row["track_id"] for row in rows})
    scored = {row["track_id"] for row in rows if row["object_category"] >= 2}
    marked = real.tracks.object_id[real.tracks.is_of_interest]
    assert {str(name) for name in marked} == scored
    ego = [row for row in rows if row["track_id"] == "AV"]
    log = real.tracks.xyz[real.ego_index, [row["timestep"] for row in ego]]
    assert log[:, 0].tolist() == [row["position_x"] for row in ego]
    assert real.current_step == max(row["timestep"] for row in rows if row["observed"])
    assert (real.current_step, real.num_steps, real.dt) == (49, 110, 0.1)
    lanes = np.isin(real.roads.map_type, scenario.LANES)
    assert lanes.sum() == len(document["lane_segments"])
    crosswalks = real.roads.map_type == MapType.CROSSWALK
    assert crosswalks.sum() == len(document["pedestrian_crossings"])


def edges_of(found: Scenario) -> list[np.ndarray]:
    """Returns the road edges."""
    rows = np.isin(found.roads.map_type, EDGES).nonzero()[0].tolist()
    return [found.roads.points_of(row) for row in rows]


@needs_real_files
def test_what_drives_in_the_real_map_is_on_the_road(real: Scenario) -> None:
    tracks, edges = real.tracks, edges_of(real)
    cars = tracks.object_type == ObjectType.VEHICLE
    drives = np.linalg.norm(tracks.velocity, axis=-1) > 1.0
    # The log reaches farther south than the map, which was cut at y = 1290 m.
    inside = tracks.xyz[..., 1] > min(edge[:, 1].min() for edge in edges)
    rows = tracks.valid & cars[:, None] & drives & inside
    distance = [metrics.signed_distance(place, edges) for place in tracks.xyz[rows]]
    assert len(distance) > 300
    assert np.mean(np.array(distance) <= 0) > 0.99


@needs_real_files
def test_velocities_of_the_real_file_are_those_of_its_positions(
    real: Scenario,
) -> None:
    tracks = real.tracks
    both = tracks.valid[:, 1:] & tracks.valid[:, :-1]
    mean = (tracks.velocity[:, 1:] + tracks.velocity[:, :-1]) / 2
    error = np.diff(tracks.xyz[..., :2], axis=1) - mean * real.dt
    assert np.median(np.linalg.norm(error[both], axis=-1)) < MEDIAN_STEP_ERROR


@needs_real_files
def test_lanes_of_the_real_map_that_follow_one_another_join(real: Scenario) -> None:
    assert real.lane_links is not None
    row_of = {int(name): row for row, name in enumerate(real.roads.feature_id)}
    joined = [
        (real.roads.points_of(row_of[a])[-1], real.roads.points_of(row_of[b])[0])
        for a, b in real.lane_links.successor.tolist()
        if a in row_of and b in row_of
    ]
    assert len(joined) > 50
    # The bounds are told to the centimetre.
    assert max(np.linalg.norm(end - start) for end, start in joined) < 0.02


@needs_real_files
def test_neighbours_in_the_real_map_lead_the_same_way(real: Scenario) -> None:
    assert real.lane_links is not None
    row_of = {int(name): row for row, name in enumerate(real.roads.feature_id)}
    assert len(real.lane_links.neighbor)
    for a, b in real.lane_links.neighbor.tolist():
        one, other = (real.roads.points_of(row_of[name]) for name in (a, b))
        # Lanes that lead opposite ways begin where the other ends.
        begin, end = (np.linalg.norm(one[0] - other[i]) for i in (0, -1))
        assert begin < end


@needs_real_files
def test_the_ego_of_the_real_file_follows_lanes(real: Scenario) -> None:
    paths = routes.paths_of(real)
    assert paths.source == "lane_graph"
    assert paths.on_route[0]


def test_a_missing_pyarrow_is_named(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = argoverse2_files.write(files.scenario(), tmp_path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pip install 'drivetrain[argoverse2]'" in reason(path)
