"""Tests of the reader of CommonRoad."""

import dataclasses
import gzip
import pathlib
import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest

from drivetrain.sim.data import build, commonroad, routes
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.scenario import EDGES, LANES, ObjectType, Scenario, ScenarioError
from tests.oracles import metrics
from tests.sim.data import commonroad_files, files

REAL_FILES = sorted((files.REAL_DATA / "commonroad_ngsim").glob("*.xml.gz"))
needs_real_files = pytest.mark.skipif(not REAL_FILES, reason=files.NO_REAL_DATA)
each_version = pytest.mark.parametrize("version", ["2018b", "2020a"])

EXACT = 1e-12  # metres: float64, means and sines of numbers of some 100
MEDIAN_SPEED_ERROR = 0.5  # metres per second between speeds and the differences of
# positions: NGSIM tells both to the decimetre and smooths them apart


def read(path: pathlib.Path) -> Scenario:
    """Reads the only scenario of a file."""
    (found,) = build.read(path)
    assert isinstance(found, Scenario), found
    return found


def converted(root: Element) -> Scenario:
    """Makes a scenario of a document."""
    return commonroad.convert(ElementTree.tostring(root))


def document(version: str = "2020a") -> Element:
    """Returns the document of the test scenario."""
    return commonroad_files.document(files.scenario(), version)


def first(root: Element, path: str) -> Element:
    """Returns the first element of a path."""
    found = root.find(path)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def real() -> list[Scenario]:
    """Returns the real scenarios."""
    return [read(path) for path in REAL_FILES]


@pytest.mark.parametrize("seed", range(3))
def test_tracks_of_the_older_version_come_back(
    tmp_path: pathlib.Path, seed: int
) -> None:
    wanted = commonroad_files.as_told(files.scenario(seed))
    found = read(commonroad_files.write(files.scenario(seed), tmp_path, "2018b"))
    assert (found.scenario_id, found.dataset) == (wanted.scenario_id, "commonroad")
    assert (found.ego_index, found.ego_source) == (wanted.ego_index, "last")
    assert (found.current_step, found.dt) == (10, wanted.dt)
    size = np.column_stack([wanted.tracks.size[:, :2], found.tracks.size[:, 2]])
    tracks = dataclasses.replace(wanted.tracks, size=size)
    assert files.differences(found.tracks, tracks, EXACT) == []


@each_version
def test_a_log_that_starts_later_starts_at_step_zero(version: str) -> None:
    root = document(version)
    plain = converted(root)
    for time in root.iterfind(".//time/exact"):
        time.text = str(int(time.text or "") + 100)
    assert files.differences(converted(root).tracks, plain.tracks) == []


@pytest.mark.parametrize(("step", "current"), [(0.04, 25), (0.1, 10), (0.2, 5)])
def test_history_takes_a_second_at_any_rate(step: float, current: int) -> None:
    root = document()
    root.set("timeStepSize", str(step))
    assert converted(root).current_step == current


def test_lights_of_a_log_that_starts_later_are_later_in_their_cycle() -> None:
    root = document()
    plain = converted(root).lights  # of 30 steps, as long as the cycles
    for time in root.iterfind(".//time/exact"):
        time.text = str(int(time.text or "") + 7)
    later = converted(root).lights
    assert (plain.state != np.roll(plain.state, -7, axis=1)).any()
    np.testing.assert_array_equal(later.state, np.roll(plain.state, -7, axis=1))


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        *((word, ObjectType.VEHICLE) for word in ("truck", "bus", "motorcycle")),
        *((word, ObjectType.VEHICLE) for word in ("parkedVehicle", "priorityVehicle")),
        ("bicycle", ObjectType.CYCLIST),
        ("pedestrian", ObjectType.PEDESTRIAN),
        ("constructionZone", ObjectType.OTHER),
    ],
)
def test_words_for_obstacles_are_known(word: str, kind: ObjectType) -> None:
    root = document()
    first(root, "dynamicObstacle/type").text = word
    found = converted(root)
    assert found.tracks.object_type[0] == kind


@each_version
def test_a_static_obstacle_stands_throughout(version: str) -> None:
    root = document(version)
    tag = "obstacle" if version == "2018b" else "dynamicObstacle"
    obstacle = root.findall(tag)[1]
    if version == "2018b":
        first(obstacle, "role").text = "static"
    else:
        obstacle.tag = "staticObstacle"
    initial = files.scenario().tracks.valid[1].argmax()
    tracks = converted(root).tracks
    assert tracks.valid[1].all()
    assert (tracks.xyz[1] == files.scenario().tracks.xyz[1, initial]).all()
    assert not tracks.velocity[1].any()


@pytest.mark.parametrize(
    ("shape", "length", "width"),
    [
        ("<rectangle><length>4</length><width>2</width></rectangle>", 4, 2),
        ("<circle><radius>0.5</radius></circle>", 1, 1),
        (
            "<polygon><point><x>-1</x><y>0</y></point><point><x>4</x><y>2</y></point>"
            "<point><x>0</x><y>-1</y></point></polygon>",
            *(5, 3),
        ),
    ],
)
def test_shapes_become_boxes(shape: str, length: float, width: float) -> None:
    root = document()
    obstacle = first(root, "dynamicObstacle")
    obstacle.remove(first(obstacle, "shape"))
    obstacle.append(ElementTree.fromstring(f"<shape>{shape}</shape>"))
    assert converted(root).tracks.size[0, :2].tolist() == [length, width]


@pytest.mark.parametrize(
    "position",
    [
        "<rectangle><length>4</length><center><x>3</x><y>-2</y></center></rectangle>",
        "<circle><radius>4</radius><center><x>3</x><y>-2</y></center></circle>",
        "<polygon><point><x>0</x><y>-4</y></point><point><x>6</x><y>0</y></point>"
        "</polygon>",
    ],
)
def test_an_uncertain_position_is_the_centre(position: str) -> None:
    root = document()
    state = first(root, "dynamicObstacle/initialState")
    state.remove(first(state, "position"))
    state.append(ElementTree.fromstring(f"<position>{position}</position>"))
    step = files.scenario().tracks.valid[0].argmax()
    assert converted(root).tracks.xyz[0, step].tolist() == [3, -2, 0]


@pytest.mark.parametrize(
    ("path", "text", "sentence"),
    [
        ("dynamicObstacle/shape/rectangle/length", "nan", "must be a finite number"),
        ("dynamicObstacle/shape/rectangle/width", "", "must be a finite number"),
        (".//trajectory/state/time/exact", "1e9", "more than 1048576 states"),
        (".//trajectory/state/time/exact", "inf", ": time must be a finite number"),
        (".//initialState/time/exact", "-1e300", "more than 1048576 states"),
        (".//state/velocity/intervalEnd", "fast", ": velocity must be a finite"),
        (".//state/position/point/x", "1e400", ": position must be a finite number"),
        ("lanelet/leftBound/point/y", "0x1p", "lanelet 11: a bound must be a finite"),
        (".//cycleElement/duration", "-1", "cycle of light 1000 has no duration"),
    ],
)
def test_a_wrong_number_is_named(path: str, text: str, sentence: str) -> None:
    root = document()
    first(root, path).text = text
    with pytest.raises(ScenarioError, match=sentence):
        converted(root)


@pytest.mark.parametrize(
    ("path", "child", "sentence"),
    [
        ("dynamicObstacle", "initialState", "obstacle [0-9]+ has no initialState"),
        ("dynamicObstacle", "shape", "obstacle [0-9]+: shape is missing"),
        (".//initialState", "position", "position is missing"),
        (".//initialState/position", "point", "position is missing"),
        (".//initialState", "orientation", "orientation is missing"),
        (".//point", "y", "a bound is missing"),
        ("lanelet", "rightBound", "lanelet 11: a bound is missing"),
    ],
)
def test_a_missing_element_is_named(path: str, child: str, sentence: str) -> None:
    root = document()
    parent = first(root, path)
    parent.remove(first(parent, child))
    with pytest.raises(ScenarioError, match=sentence):
        converted(root)


def test_bounds_need_not_have_as_many_points() -> None:
    root = document()
    bound = first(root, "lanelet/rightBound")
    bound.remove(first(bound, "point"))
    assert converted(root).roads.feature_id[0] == 11


@pytest.mark.parametrize(
    ("path", "name", "value", "sentence"),
    [
        (".", "timeStepSize", "0", "timeStepSize must be a length of at most 10 s"),
        (".", "timeStepSize", "nan", "timeStepSize must be a length of at most 10 s"),
        (".", "benchmarkID", "", "there is no commonRoad with a benchmarkID"),
        ("lanelet", "id", "one", "'id' of a lanelet must be an integer, got 'one'"),
        ("dynamicObstacle", "id", str(2**63), "'id' of an obstacle must be an integer"),
        ("lanelet/successor", "ref", "", "'ref' of a successor must be an integer"),
    ],
)
def test_a_wrong_attribute_is_named(
    path: str, name: str, value: str, sentence: str
) -> None:
    root = document()
    first(root, path).set(name, value)
    with pytest.raises(ScenarioError, match=sentence):
        converted(root)


def test_two_states_at_one_step_are_named() -> None:
    root = document()
    times = root.findall("dynamicObstacle/trajectory/state/time/exact")
    times[1].text = times[0].text
    with pytest.raises(ScenarioError, match="has two states at one step"):
        converted(root)


def test_a_scenario_without_obstacles_is_named() -> None:
    root = document()
    for obstacle in root.findall("dynamicObstacle"):
        root.remove(obstacle)
    with pytest.raises(ScenarioError, match="there is no obstacle"):
        converted(root)


@each_version
def test_the_format_is_told_from_the_content(
    tmp_path: pathlib.Path, version: str
) -> None:
    path = commonroad_files.write(files.scenario(), tmp_path, version)
    text = path.read_bytes()
    plain = read(path)
    heads = (text, b"\xef\xbb\xbf" + text, b"<?xml version='1.0'?>\n<!-- a -->" + text)
    for head in heads:
        path.write_bytes(head)
        assert files.differences(read(path), plain) == []


def test_other_xml_is_of_no_known_format(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(b"<?xml version='1.0'?><osm><node/></osm>")
    (bad,) = build.read(path)
    assert isinstance(bad, BadRecord)
    assert "no known format" in bad.reason


@needs_real_files
def test_the_real_files_hold_what_their_text_tells(real: list[Scenario]) -> None:
    for path, found in zip(REAL_FILES, real, strict=True):
        text = gzip.decompress(path.read_bytes()).decode()
        assert found.scenario_id == path.name.removesuffix(".xml.gz")
        names = re.findall(r'<obstacle id="(\d+)"', text)
        assert found.tracks.object_id.tolist() == [int(name) for name in names]
        assert found.tracks.valid.sum() == len(names) + text.count("<state>")
        lanes = found.roads.feature_id[np.isin(found.roads.map_type, LANES)]
        lane_names = re.findall(r'<lanelet id="(\d+)"', text)
        assert lanes.tolist() == [int(name) for name in lane_names]
        assert found.lane_links is not None
        assert len(found.lane_links.successor) == text.count("<successor ")
        assert len(found.lane_links.neighbor) == text.count('drivingDir="same"')
        assert len(found.lane_links.limit) == text.count("<speedLimit>")


@needs_real_files
def test_a_real_file_holds_the_states_that_a_plain_parser_finds(
    real: list[Scenario],
) -> None:
    root = ElementTree.fromstring(gzip.decompress(REAL_FILES[0].read_bytes()))
    tracks = real[0].tracks
    for i, obstacle in enumerate(root.iterfind("obstacle")):
        for state in obstacle.iterfind("trajectory/state"):
            step = int(state.findtext("time/exact", ""))
            x, y = (state.findtext(f"position/point/{axis}", "") for axis in "xy")
            speed = float(state.findtext("velocity/exact", ""))
            assert tracks.valid[i, step]
            assert tracks.xyz[i, step].tolist() == [float(x), float(y), 0]
            assert abs(np.hypot(*tracks.velocity[i, step]) - abs(speed)) < EXACT


@needs_real_files
def test_real_cars_are_on_the_road(real: list[Scenario]) -> None:
    for found in real:
        rows = np.isin(found.roads.map_type, EDGES).nonzero()[0].tolist()
        edges = [found.roads.points_of(row) for row in rows]
        places = found.tracks.xyz[found.tracks.valid][::40]
        distances = [metrics.signed_distance(place, edges) for place in places]
        assert max(distances) < 0


@needs_real_files
def test_velocities_of_the_real_files_are_those_of_their_positions(
    real: list[Scenario],
) -> None:
    for found in real:
        tracks = found.tracks
        both = tracks.valid[:, 1:] & tracks.valid[:, :-1]
        mean = (tracks.velocity[:, 1:] + tracks.velocity[:, :-1]) / 2
        error = np.diff(tracks.xyz[..., :2], axis=1) / found.dt - mean
        median = np.median(np.linalg.norm(error[both], axis=-1))
        assert median < MEDIAN_SPEED_ERROR


@needs_real_files
def test_real_lanes_that_follow_one_another_join(real: list[Scenario]) -> None:
    for found in real:
        assert found.lane_links is not None
        row_of = {int(name): row for row, name in enumerate(found.roads.feature_id)}
        for a, b in found.lane_links.successor.tolist():
            end = found.roads.points_of(row_of[a])[-1]
            start = found.roads.points_of(row_of[b])[0]
            assert np.linalg.norm(end - start) < 0.001  # told to a tenth of that


@needs_real_files
def test_real_egos_follow_lanes(real: list[Scenario]) -> None:
    for found in real[::6]:
        paths = routes.paths_of(found)
        assert paths.source == "lane_graph"
        assert paths.on_route[0]
