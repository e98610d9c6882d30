"""Writes scenarios as the pickles of ScenarioNet, and reads real ones, for tests."""

import pathlib
import pickle
from typing import Any

import numpy as np

from drivetrain.sim.scenario import LightState, MapType, ObjectType, Scenario
from tests.sim.data.files import METERS_PER_SECOND, POLYGONS, open_run

SPELLINGS = {
    MapType.LANE_UNDEFINED: "LANE_UNKNOWN",
    MapType.LANE_FREEWAY: "LANE_FREEWAY",
    MapType.LANE_SURFACE_STREET: "LANE_SURFACE_STREET",
    MapType.LANE_BIKE: "LANE_BIKE_LANE",
    MapType.LINE_SOLID_SINGLE_WHITE: "ROAD_LINE_SOLID_SINGLE_WHITE",
    MapType.LINE_PASSING_DOUBLE_YELLOW: "ROAD_LINE_PASSING_DOUBLE_YELLOW",
    MapType.EDGE_BOUNDARY: "ROAD_EDGE_BOUNDARY",
    MapType.EDGE_MEDIAN: "ROAD_EDGE_MEDIAN",
    MapType.STOP_SIGN: "STOP_SIGN",
    MapType.CROSSWALK: "CROSSWALK",
    MapType.SPEED_BUMP: "SPEED_BUMP",
    MapType.DRIVEWAY: "DRIVEWAY",
}


def document(wanted: Scenario) -> dict[str, Any]:
    """Returns what a pickle of ScenarioNet holds, in its newer form."""
    tracks = wanted.tracks
    names = [str(number) for number in tracks.object_id]
    (predicted, *interesting) = tracks.is_of_interest.nonzero()[0].tolist()
    return {
        "id": wanted.scenario_id,
        "version": "made by a test",
        "length": wanted.num_steps,
        "metadata": {
            "dataset": "waymo",
            "ts": np.arange(wanted.num_steps) * wanted.dt,
            "sdc_id": names[wanted.ego_index],
            "current_time_index": wanted.current_step,
            "objects_of_interest": [names[i] for i in interesting],
            "tracks_to_predict": {names[predicted]: {"track_index": predicted}},
        },
        "tracks": {name: track(wanted, index) for index, name in enumerate(names)},
        "map_features": {
            str(number): feature(wanted, index)
            for index, number in enumerate(wanted.roads.feature_id)
        },
        "dynamic_map_states": {
            str(lane): light(wanted, index)
            for index, lane in enumerate(wanted.lights.lane_id)
        },
    }


def track(wanted: Scenario, index: int) -> dict[str, Any]:
    """Returns one track, with junk where it is not valid."""
    tracks, valid = wanted.tracks, wanted.tracks.valid[index]

    def told(values: np.ndarray) -> np.ndarray:
        mask = valid.reshape(-1, *[1] * (values.ndim - 1))
        return np.where(mask, values, -7.0)

    sizes = {
        name: told(np.full(len(valid), tracks.size[index, axis]))
        for axis, name in enumerate(("length", "width", "height"))
    }
    return {
        "type": ObjectType(tracks.object_type[index]).name,
        "state": {
            "position": told(tracks.xyz[index]),
            "heading": told(tracks.yaw[index]),
            "velocity": told(tracks.velocity[index]),
            "valid": valid,
            **sizes,
        },
        "metadata": {"track_length": len(valid)},
    }


def feature(wanted: Scenario, index: int) -> dict[str, Any]:
    """Returns one map feature, with its links by the numbers of the others."""
    roads, links = wanted.roads, wanted.lane_links
    kind, own = MapType(roads.map_type[index]), roads.feature_id[index]
    points = open_run(roads, index)
    if links is None:
        return {"type": SPELLINGS[kind], "polyline": points}
    if kind == MapType.STOP_SIGN:
        lanes = links.stop[links.stop[:, 0] == own, 1]
        return {"type": "STOP_SIGN", "position": points[0], "lane": lanes.tolist()}
    if kind > MapType.LANE_BIKE:
        place = "polygon" if kind in POLYGONS else "polyline"
        return {"type": SPELLINGS[kind], place: points}
    beside = links.neighbor[links.neighbor[:, 0] == own, 1]
    limit = links.limit[links.limited == own]
    return {
        "type": SPELLINGS[kind],
        "polyline": points,
        "speed_limit_kmh": float(limit[0] / METERS_PER_SECOND["kmh"])
        if limit.size
        else None,
        "entry_lanes": links.successor[links.successor[:, 1] == own, 0].tolist(),
        "exit_lanes": links.successor[links.successor[:, 0] == own, 1].tolist(),
        "left_neighbor": [{"feature_id": str(lane)} for lane in beside[::2]],
        "right_neighbor": [{"feature_id": str(lane)} for lane in beside[1::2]],
    }


def light(wanted: Scenario, index: int) -> dict[str, Any]:
    """Returns one light: a word for each step, or None where it was not seen."""
    lights = wanted.lights
    words = [
        f"LANE_STATE_{LightState(state).name}" if seen else None
        for state, seen in zip(lights.state[index], lights.valid[index], strict=True)
    ]
    return {
        "type": "TRAFFIC_LIGHT",
        "lane": int(lights.lane_id[index]),
        "stop_point": lights.xyz[index],
        "state": {"object_state": words},
    }


def scenarionet_file(wanted: Scenario, protocol: int = 4) -> bytes:
    """Encodes a scenario as a pickle."""
    return pickle.dumps(document(wanted), protocol)


class Trusting(pickle.Unpickler):
    """Loads a file that is trusted, with dictionaries for classes not installed."""

    def find_class(self, module: str, name: str) -> Any:
        """Returns the class, or `dict` for one of MetaDrive."""
        is_ours = module.startswith("metadrive")
        return dict if is_ours else super().find_class(module, name)


def trusted(path: pathlib.Path) -> Any:
    """Returns what `pickle` makes of a file that is trusted."""
    with path.open("rb") as stream:
        return Trusting(stream).load()
