"""Reads the traffic lights of CommonRoad 2020a, which repeat a cycle of colours."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Int

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


def read(root: Element, lanes: Sequence[Lane], num_steps: int) -> Lights:
    """Returns the lights, one for each lane that refers to one.

    A lane with several lights gets the first. It stops at the stop line, or at its end
    where no line is drawn.

    Raises:
        ScenarioError: if a light or a lanelet is malformed.
    """
    cycles = {}
    for light in root.iterfind("trafficLight"):
        light_id = values.integer(light.get("id"), "'id' of a trafficLight")
        if (light.findtext("active") or "true").strip() == "true":
            cycles[light_id] = _states(light, light_id, num_steps)
    ends = {lane.lane_id: lane.end for lane in lanes}
    rows = []
    for lanelet in root.iterfind("lanelet"):
        lane = values.integer(lanelet.get("id"), "'id' of a lanelet")
        known = [
            light
            for tag in ("trafficLightRef", "stopLine/trafficLightRef")
            for light in values.references(lanelet, tag)
            if light in cycles
        ]
        if known and lane in ends:
            line = lanelet.find("stopLine")
            drawn = [] if line is None else values.points(line, f"stop line of {lane}")
            rows.append(
                (lane, known[0], np.mean(drawn, 0) if len(drawn) else ends[lane])
            )
    if len(rows) * num_steps > parts.MAX_LIGHT_STEPS:
        raise ScenarioError(f"{len(rows)} lanes with lights are too many")
    if not rows:
        return parts.no_lights(num_steps)
    lane_id, light, xyz = zip(*rows, strict=True)
    step = np.arange(num_steps)
    return parts.lights(
        lane_id=np.repeat(np.array(lane_id), num_steps),
        step=np.tile(step, len(rows)),
        state=np.concatenate([cycles[name] for name in light]),
        xyz=np.repeat(np.stack(xyz), num_steps, axis=0),
        valid=np.ones(len(rows) * num_steps, bool),
        num_steps=num_steps,
    )


def _states(light: Element, light_id: int, num_steps: int) -> Int[np.ndarray, " steps"]:
    """Returns what a light shows at each step; what is dark or unknown is unknown."""
    place = f"the cycle of light {light_id}"
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
    within = np.mod(np.arange(num_steps) - shift, ends[-1])
    return np.array(colours, np.int64)[
        np.minimum(np.searchsorted(ends, within, side="right"), len(ends) - 1)
    ]
