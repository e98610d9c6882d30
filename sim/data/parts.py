"""Builds parts of a scenario from the columns that the readers of WOMD find."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .. import scenario
from ..scenario import (
    LaneLinks,
    Lights,
    LightState,
    MapType,
    ObjectType,
    Polylines,
    ScenarioError,
)

MPH, KMH = 0.44704, 1 / 3.6  # metres per second
POLYGONS = (MapType.CROSSWALK, MapType.SPEED_BUMP, MapType.DRIVEWAY)
CLOCK_JITTER = 0.0005  # seconds about 0.1 s
MAX_STATES = 1 << 20  # tracks times steps: five times a crowd of 1,000 over 20 s
MAX_POINTS = 1 << 21  # of a map: fifty times the largest seen
NO_LANE_GRAPH = "lane links from lane ends, no speed limits"  # an assumption
MAX_LIGHT_STEPS = 10**7  # beyond, a damaged record would ask for gigabytes


def require_few(count: int, most: int, what: str) -> None:
    """Checks a count before memory is asked for on its word.

    Raises:
        ScenarioError: if there are more than the most that a scenario has.
    """
    if count > most:
        raise ScenarioError(
            f"there are {count} {what}, and at most {most} are read; this is no file "
            "of one scenario"
        )


def zero_unless(
    valid: Bool[np.ndarray, "*leading"], values: Float[np.ndarray, "*leading features"]
) -> Float[np.ndarray, "*leading features"]:
    """Returns the values in float64, zero where they are not valid."""
    return np.where(valid[..., None], values, 0.0).astype(np.float64)


def wrap_angle(angle: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """Returns the angle [rad] in [-pi, pi]; one that lies there stays as it is."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def step_length(seconds: Sequence[float]) -> float:
    """Returns the median time from a step to the next [s].

    Within half a millisecond of 0.1 s, it is that: clocks jitter.

    Raises:
        ScenarioError: if the times do not rise.
    """
    steps = np.diff(np.array(seconds, np.float64))
    median = float(np.median(steps)) if len(steps) else scenario.DT
    if not 0 < median < np.inf:
        raise ScenarioError(f"the times of the steps do not rise: {median} s apart")
    return scenario.DT if abs(median - scenario.DT) <= CLOCK_JITTER else median


def object_types(codes: Int[np.ndarray, " objects"]) -> Int[np.ndarray, " objects"]:
    """Returns codes of WOMD as `ObjectType`: negative is unset, unknown is other."""
    known = np.where(codes > max(ObjectType), ObjectType.OTHER, codes)
    return np.maximum(known, ObjectType.UNSET)


def constant_size(
    size: Float[np.ndarray, "objects steps 3"],
    valid: Bool[np.ndarray, "objects steps"],
    current_step: int,
) -> Float[np.ndarray, "objects 3"]:
    """Returns one size [m] for each object: that of the valid step nearest to now.

    An object that is never valid has size zero.

    Raises:
        ScenarioError: if there is no step.
    """
    num_objects, num_steps = valid.shape
    if num_steps == 0:
        raise ScenarioError("the tracks have no steps")
    distance = np.abs(np.arange(num_steps) - current_step)
    nearest = np.where(valid, distance, distance.max() + 1).argmin(axis=1)
    rows = np.arange(num_objects)
    return zero_unless(valid[rows, nearest], size[rows, nearest])


def polylines(
    xyz: Float[np.ndarray, "points 3"],
    num_points: Int[np.ndarray, " features"],
    map_type: Int[np.ndarray, " features"],
    feature_id: Int[np.ndarray, " features"],
) -> Polylines:
    """Splits points into features, and closes polygons that are open.

    Of a sign the first point counts.

    Args:
        xyz: points of all features, one feature after the other.
        num_points: of each feature; features without points are left out.
        map_type: of each feature.
        feature_id: of each feature.

    Returns:
        The features.
    """
    is_sign = map_type == MapType.STOP_SIGN
    place = np.arange(len(xyz)) - np.repeat(
        np.cumsum(num_points) - num_points, num_points
    )
    xyz = xyz[(place == 0) | ~np.repeat(is_sign, num_points)]
    num_points = np.where(is_sign, np.minimum(num_points, 1), num_points)
    kept = num_points > 0
    num_points, map_type = num_points[kept], map_type[kept]
    end = np.cumsum(num_points)
    first, last = xyz[end - num_points], xyz[end - 1]

    is_open = np.isin(map_type, POLYGONS) & (first != last).any(axis=1)
    return Polylines(
        xyz=np.insert(xyz, end[is_open], first[is_open], axis=0),
        offset=np.concatenate([[0], np.cumsum(num_points + is_open)]),
        map_type=map_type,
        feature_id=feature_id[kept],
    )


def lights(
    *,
    lane_id: Int[np.ndarray, " rows"],
    step: Int[np.ndarray, " rows"],
    state: Int[np.ndarray, " rows"],
    xyz: Float[np.ndarray, "rows 3"],
    valid: Bool[np.ndarray, " rows"],
    num_steps: int,
) -> Lights:
    """Groups what was seen of lights, one row for a lane at a step, by lane.

    A light stands where it was first seen. States that WOMD does not know are UNKNOWN.

    Args:
        lane_id: the lane that the light controls.
        step: when it was seen.
        state: what it showed, as `LightState`.
        xyz: its stop point [m].
        valid: whether the row tells a state and a place.
        num_steps: of the scenario.

    Returns:
        The lights, ordered by lane.

    Raises:
        ScenarioError: if a step lies outside the scenario, or there are absurdly many
            lanes.
    """
    outside = (step < 0) | (step >= num_steps)
    if outside.any():
        raise ScenarioError(
            f"a traffic light is told for step {step[outside][0]} of {num_steps} steps"
        )
    lanes, row = np.unique(lane_id, return_inverse=True)
    if len(lanes) * num_steps > MAX_LIGHT_STEPS:
        raise ScenarioError(
            f"{len(lanes)} lanes with traffic lights over {num_steps} steps are more "
            f"than {MAX_LIGHT_STEPS} states"
        )
    grid_state = np.full((len(lanes), num_steps), LightState.UNKNOWN, np.int64)
    grid_valid = np.zeros((len(lanes), num_steps), bool)
    place = np.zeros((len(lanes), 3))

    is_known = np.isin(state, list(LightState))
    grid_state[row, step] = np.where(valid & is_known, state, LightState.UNKNOWN)
    grid_valid[row, step] = valid
    # Of several assignments to one place the last one stays: the earliest step.
    latest_first = np.argsort(-step, kind="stable")
    latest_first = latest_first[valid[latest_first]]
    place[row[latest_first]] = xyz[latest_first]
    return Lights(lane_id=lanes, xyz=place, state=grid_state, valid=grid_valid)


def lane_links(
    successor: Iterable[tuple[int, int]],
    neighbor: Iterable[tuple[int, int]],
    stop: Iterable[tuple[int, int]],
    limits: Mapping[int, float],
) -> LaneLinks:
    """Gathers links of lanes, each once: lanes name one another at both ends.

    Args:
        successor: from a lane into the next.
        neighbor: from a lane into one beside it.
        stop: a stop sign, and a lane that it stops.
        limits: speed limits by lane [m/s]; those that are not positive, finite numbers
            are none.
    """
    known = {lane: v for lane, v in sorted(limits.items()) if 0 < v < np.inf}
    return LaneLinks(
        successor=_pairs(successor),
        neighbor=_pairs(neighbor),
        stop=_pairs(stop),
        limited=np.array(list(known), np.int64),
        limit=np.array(list(known.values()), np.float64),
    )


def _pairs(links: Iterable[tuple[int, int]]) -> Int[np.ndarray, "links 2"]:
    return np.array(sorted(set(links)), np.int64).reshape(-1, 2)


def seen_lights(lights: Lights) -> Lights:
    """Leaves out lights that were never seen: they have no place."""
    seen = lights.valid.any(axis=1)
    return Lights(
        lane_id=lights.lane_id[seen],
        xyz=lights.xyz[seen],
        state=lights.state[seen],
        valid=lights.valid[seen],
    )


def no_lights(num_steps: int) -> Lights:
    """Returns the lights of a scenario that has none."""
    return Lights(
        lane_id=np.zeros(0, np.int64),
        xyz=np.zeros((0, 3)),
        state=np.zeros((0, num_steps), np.int64),
        valid=np.zeros((0, num_steps), bool),
    )


def of_interest(
    object_id: Int[np.ndarray, " objects"],
    interesting_ids: list[int],
    predicted_indices: list[int],
) -> Bool[np.ndarray, " objects"]:
    """Marks the objects that WOMD lists as interacting or to be predicted.

    Raises:
        ScenarioError: if a track to predict is not among the tracks.
    """
    num_objects = len(object_id)
    for index in predicted_indices:
        if not 0 <= index < num_objects:
            raise ScenarioError(
                f"tracks_to_predict names track {index}, but there are {num_objects}"
            )
    marked = np.isin(object_id, interesting_ids)
    marked[predicted_indices] = True
    return marked
