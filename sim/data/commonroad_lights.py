"""Reads the traffic lights of CommonRoad 2020a, which repeat a cycle of colours."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float, Int

from ..scenario import Lights, LightState, ScenarioError
from . import commonroad_values as values, parts
from .lane_map import Lane

# Red with yellow still forbids to go.
_STATES = {
    "red": LightState.STOP,
    "redYellow": LightState.STOP,
    "yellow": LightState.CAUTION,
    "green": LightState.GO,
}


def read(
    root: Element, lanes: Sequence[Lane], steps: Float[np.ndarray, " steps"]
) -> Lights:
    """Returns the lights, one for each lane that refers to one.

    A lane with several lights gets the first. It stops at the stop line, or at its end
    where no line is drawn.

    Args:
        root: of the document.
        lanes: of its map.
        steps: of the log, as the file counts them: the cycles begin at its step 0.

    Raises:
        ScenarioError: if a light or a lanelet is malformed.
    """
    found = {}
    for light in root.iterfind("trafficLight"):
        if (light.findtext("active") or "true").strip() == "true":
            found[values.integer(light.get("id"), "'id' of a trafficLight")] = light
    ends = {lane.lane_id: lane.end for lane in lanes}
    ruled = {}
    for lanelet in root.iterfind("lanelet"):
        lane = values.integer(lanelet.get("id"), "'id' of a lanelet")
        known = [
            light
            for tag in ("trafficLightRef", "stopLine/trafficLightRef")
            for light in values.references(lanelet, tag)
            if light in found
        ]
        if known and lane in ends:
            line = lanelet.find("stopLine")
            drawn = [] if line is None else values.points(line, f"stop line of {lane}")
            ruled[lane] = known[0], np.mean(drawn, 0) if len(drawn) else ends[lane]
    num_steps = len(steps)
    if len(ruled) * num_steps > parts.MAX_LIGHT_STEPS:
        raise ScenarioError(f"{len(ruled)} lanes with lights are too many")
    if not ruled:
        return parts.no_lights(num_steps)
    lane_id = sorted(ruled)
    # Once for each light: thousands of lanes may share one of a long cycle.
    lights = {light for light, _ in ruled.values()}
    shown = {light: _states(found[light], steps) for light in lights}
    state = [shown[ruled[lane][0]] for lane in lane_id]
    return Lights(
        lane_id=np.array(lane_id, np.int64),
        xyz=np.stack([ruled[lane][1] for lane in lane_id]),
        state=np.stack(state),
        valid=np.ones((len(lane_id), num_steps), bool),
    )


def _states(
    light: Element, steps: Float[np.ndarray, " steps"]
) -> Int[np.ndarray, " steps"]:
    """Returns what a light shows at each step; what is dark or unknown is unknown."""
    place = f"the cycle of light {light.get('id')}"
    colours, durations = [], []
    for element in light.iterfind("cycle/cycleElement"):
        colour = (element.findtext("color") or "").strip()
        colours.append(_STATES.get(colour, LightState.UNKNOWN))
        durations.append(values.number(element.find("duration"), place))
    ends = np.cumsum(durations)
    if not durations or min(durations) < 0 or not 0 < ends[-1] < np.inf:
        raise ScenarioError(f"{place} has no duration")
    offset = light.find("cycle/timeOffset")
    shift = 0.0 if offset is None else values.number(offset, place)
    within = np.mod(steps - shift, ends[-1])
    return np.array(colours, np.int64)[
        np.minimum(np.searchsorted(ends, within, side="right"), len(ends) - 1)
    ]
