"""States what a scenario is: a stretch of logged traffic with its map, on the host.

Readers make scenarios from files, `data.pack` turns them into the form of the device.
Arrays are NumPy; positions are metres in the file's own map frame, in float64.
"""

import dataclasses
import enum
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

EgoSource = Literal["marked", "last", "farthest"]


class ScenarioError(ValueError):
    """A record that is no usable scenario; the message says why and what would help."""


class ObjectType(enum.IntEnum):
    """Kinds of road users, numbered as in WOMD."""

    UNSET = 0
    VEHICLE = 1
    PEDESTRIAN = 2
    CYCLIST = 3
    OTHER = 4


class MapType(enum.IntEnum):
    """Kinds of map features, numbered as `roadgraph_samples/type` of WOMD."""

    LANE_UNDEFINED = 0
    LANE_FREEWAY = 1
    LANE_SURFACE_STREET = 2
    LANE_BIKE = 3
    LINE_UNKNOWN = 5
    LINE_BROKEN_SINGLE_WHITE = 6
    LINE_SOLID_SINGLE_WHITE = 7
    LINE_SOLID_DOUBLE_WHITE = 8
    LINE_BROKEN_SINGLE_YELLOW = 9
    LINE_BROKEN_DOUBLE_YELLOW = 10
    LINE_SOLID_SINGLE_YELLOW = 11
    LINE_SOLID_DOUBLE_YELLOW = 12
    LINE_PASSING_DOUBLE_YELLOW = 13
    EDGE_UNKNOWN = 14
    EDGE_BOUNDARY = 15
    EDGE_MEDIAN = 16
    STOP_SIGN = 17
    CROSSWALK = 18
    SPEED_BUMP = 19
    DRIVEWAY = 20


DT = 0.1  # seconds between steps, unless a file says otherwise
NUM_MAP_TYPES = len(MapType) + 1  # the codes run to 20, and 4 is not used
SAME_LEVEL = 3.0  # metres between heights, up to which things share a road
MAX_EXTENT = 10_000.0  # metres that a scene may reach
MAX_TRAVEL = 5_000.0  # metres that the ego may travel
LANES = (
    MapType.LANE_UNDEFINED,
    MapType.LANE_FREEWAY,
    MapType.LANE_SURFACE_STREET,
    MapType.LANE_BIKE,
)
DRIVING_LANES = LANES[:3]
EDGES = (MapType.EDGE_UNKNOWN, MapType.EDGE_BOUNDARY, MapType.EDGE_MEDIAN)


class LightState(enum.IntEnum):
    """What a traffic light shows, numbered as in WOMD."""

    UNKNOWN = 0
    ARROW_STOP = 1
    ARROW_CAUTION = 2
    ARROW_GO = 3
    STOP = 4
    CAUTION = 5
    GO = 6
    FLASHING_STOP = 7
    FLASHING_CAUTION = 8


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """The logged motion of every road user. Where not valid, values mean nothing."""

    object_id: Int[np.ndarray, " objects"]
    object_type: Int[np.ndarray, " objects"]  # ObjectType
    xyz: Float[np.ndarray, "objects steps 3"]  # centre of the box [m]
    yaw: Float[np.ndarray, "objects steps"]  # radians, anticlockwise from +x
    velocity: Float[np.ndarray, "objects steps 2"]  # metres per second
    valid: Bool[np.ndarray, "objects steps"]
    size: Float[np.ndarray, "objects 3"]  # length, width, height [m]
    is_of_interest: Bool[
        np.ndarray, " objects"
    ]  # marked by the data set as interacting


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Polylines:
    """Map features as runs of points; a sign is a run of one.

    Feature i has the points `offset[i]` to `offset[i + 1]`. Road edges have the road on
    their left. Polygons repeat their first point at the end.
    """

    xyz: Float[np.ndarray, "points 3"]
    offset: Int[np.ndarray, " features_plus_1"]
    map_type: Int[np.ndarray, " features"]  # MapType
    feature_id: Int[np.ndarray, " features"]

    @property
    def num_features(self) -> int:
        """How many features there are."""
        return len(self.map_type)

    def points_of(self, feature: int) -> Float[np.ndarray, "points 3"]:
        """Returns the points of one feature."""
        return self.xyz[self.offset[feature] : self.offset[feature + 1]]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LaneLinks:
    """What ties lanes to one another and to rules, by feature ids.

    Ids that no feature has are passed over.
    """

    successor: Int[np.ndarray, "successors 2"]  # from a lane's end into the next lane
    neighbor: Int[np.ndarray, "neighbors 2"]  # a lane change to the second
    stop: Int[np.ndarray, "stops 2"]  # a stop sign, and a lane that it stops
    limited: Int[np.ndarray, " limits"]  # lanes with a speed limit, each once
    limit: Float[np.ndarray, " limits"]  # their speed limits [m/s]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Lights:
    """Traffic lights, one per controlled lane."""

    lane_id: Int[np.ndarray, " lights"]
    xyz: Float[np.ndarray, "lights 3"]  # the stop point
    state: Int[np.ndarray, "lights steps"]  # LightState
    valid: Bool[np.ndarray, "lights steps"]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """Ways that the ego could take from its start, as runs of points along lanes."""

    xyz: Float[np.ndarray, "points 3"]
    offset: Int[np.ndarray, " paths_plus_1"]
    speed_limit: Float[np.ndarray, " points"]  # metres per second, where it is limited
    is_limited: Bool[np.ndarray, " points"]  # the format tells a limit
    on_route: Bool[np.ndarray, " paths"]  # follows the road that the log took
    source: str  # path_samples, lane_graph, lane_ends or log

    def points_of(self, path: int) -> Float[np.ndarray, "points 3"]:
        """Returns the points of one path."""
        return self.xyz[self.offset[path] : self.offset[path + 1]]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """One stretch of logged traffic with its map."""

    scenario_id: str
    dataset: str  # the reader that made it
    dt: float = DT  # seconds between steps
    current_step: int = 10  # the last step of history; simulation starts from it
    tracks: Tracks
    ego_index: int
    ego_source: EgoSource
    roads: Polylines
    lights: Lights
    lane_links: LaneLinks | None  # None where the format carries no lane graph
    paths: Paths | None = None  # None until `data.routes` has found them
    assumptions: tuple[str, ...] = ()  # what the format does not say, in a few words

    @property
    def num_steps(self) -> int:
        """How many logged steps there are, history and current step included."""
        return self.tracks.valid.shape[1]

    @property
    def origin(self) -> Float[np.ndarray, " 3"]:
        """Where the ego is at the current step: the origin on the device."""
        return self.tracks.xyz[self.ego_index, self.current_step]


def choose_ego(tracks: Tracks, marked: int | None) -> tuple[int, EgoSource]:
    """Chooses the ego (`definitions.md` section 1).

    The marked car; else the last object if it is a vehicle valid at every step, as WOMD
    lists its own car last; else the vehicle valid throughout that travels farthest.

    Raises:
        ScenarioError: if the mark points outside the tracks, or no vehicle qualifies.
    """
    num_objects = len(tracks.object_id)
    if marked is not None and marked >= 0:
        if marked >= num_objects:
            raise ScenarioError(
                f"the ego is marked as track {marked} of {num_objects} tracks"
            )
        return marked, "marked"
    candidate = (tracks.object_type == ObjectType.VEHICLE) & tracks.valid.all(axis=1)
    if not candidate.any():
        raise ScenarioError(
            "no ego: no track is marked as the self-driving car and no vehicle is "
            "valid at every step; mark one in the file"
        )
    if candidate[-1]:
        return num_objects - 1, "last"
    travelled = np.linalg.norm(np.diff(tracks.xyz[..., :2], axis=1), axis=-1).sum(
        axis=1
    )
    return int(np.argmax(np.where(candidate, travelled, -1.0))), "farthest"


def check(scenario: Scenario) -> Scenario:
    """Returns the scenario if it can be simulated.

    Raises:
        ScenarioError: if the log is too short, the ego is absent at the current step or
            at all later ones, there is no map, a value that is marked valid is not
            finite or beyond 10,000 km, or places lie too far apart.
    """
    tracks, current = scenario.tracks, scenario.current_step
    if scenario.num_steps < current + 2:
        raise ScenarioError(
            f"too short: {scenario.num_steps} steps, at least {current + 2} are needed "
            f"({current + 1} of history and one to simulate); an earlier current step "
            "(--timeline.current-step) asks for less"
        )
    ego_valid = tracks.valid[scenario.ego_index]
    if not ego_valid[current] or not ego_valid[current + 1 :].any():
        raise ScenarioError(
            f"the ego (object {tracks.object_id[scenario.ego_index]}) is not valid at "
            f"the current step {current} and at a later one"
        )
    if scenario.roads.num_features == 0:
        raise ScenarioError("no road: the record has no map features")
    for name, values, mask in (
        ("tracks.xyz", tracks.xyz, tracks.valid[..., None]),
        ("tracks.yaw", tracks.yaw, tracks.valid),
        ("tracks.velocity", tracks.velocity, tracks.valid[..., None]),
        ("tracks.size", tracks.size, tracks.valid.any(axis=1, keepdims=True)),
        ("roads.xyz", scenario.roads.xyz, np.array(True)),
        (
            "lights.xyz",
            scenario.lights.xyz,
            scenario.lights.valid.any(axis=1, keepdims=True),
        ),
    ):
        bad = mask & ~(np.abs(values) < 1e7)
        if bad.any():
            place = [int(i) for i in np.argwhere(bad)[0]]
            raise ScenarioError(
                f"{name}{place} is {values[*place]}: not a finite number of metres"
            )
    if (tracks.size[tracks.valid.any(axis=1)] < 0).any():
        raise ScenarioError("tracks.size has a negative length, width or height")
    _check_extent(scenario)
    return scenario


def _check_extent(scenario: Scenario) -> None:
    """Raises ScenarioError where places lie too far apart to be one scene."""
    tracks, lights, paths = scenario.tracks, scenario.lights, scenario.paths
    places = [tracks.xyz[tracks.valid], scenario.roads.xyz]
    places += [lights.xyz[lights.valid.any(axis=1)]]
    places += [] if paths is None else [paths.xyz]
    extent = float(np.ptp(np.concatenate(places), axis=0).max())
    ego = scenario.ego_index
    way = np.diff(tracks.xyz[ego, tracks.valid[ego]], axis=0)
    travel = float(np.linalg.norm(way, axis=1).sum())
    for name, value, limit in (
        ("the scene reaches", extent, MAX_EXTENT),
        ("the ego travels", travel, MAX_TRAVEL),
    ):
        if not value <= limit:
            raise ScenarioError(
                f"{name} {value / 1e3:,.1f} km, at most {limit / 1e3:.0f} km fit; cut "
                "the scene, or mend places that jump"
            )
