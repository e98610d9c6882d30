"""Writes scenarios as the binary maps of PufferDrive, for tests."""

import struct

import numpy as np

from drivetrain.sim.scenario import MapType, Scenario
from tests.sim.data.files import open_run

NO_VALUES = struct.pack("<6fi", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


def code(kind: int) -> int:
    """Returns how the format numbers a MapType: by its kind alone."""
    if kind >= MapType.STOP_SIGN:
        return kind - MapType.STOP_SIGN + 7
    return 4 if kind <= MapType.LANE_BIKE else 5 if kind < MapType.EDGE_UNKNOWN else 6


def puffer_file(wanted: Scenario) -> bytes:
    """Encodes a scenario, with -10000 where an object is not valid."""
    tracks, roads = wanted.tracks, wanted.roads
    blocks = [struct.pack("<ii", len(tracks.valid), roads.num_features)]
    for i, valid in enumerate(tracks.valid):
        length, width, height = tracks.size[i]
        columns = [*tracks.xyz[i].T, *tracks.velocity[i].T, 0 * valid, tracks.yaw[i]]
        told = np.where(valid, np.stack(columns), -10000.0)
        blocks += [
            struct.pack("<iii", tracks.object_type[i], tracks.object_id[i], len(valid)),
            told.astype("<f4").tobytes(),
            valid.astype("<i4").tobytes(),
            struct.pack("<6fi", width, length, height, 1.0, 2.0, 3.0, 0),
        ]
    for i in range(roads.num_features):
        points = open_run(roads, i)
        kind = code(int(roads.map_type[i]))
        blocks += [
            struct.pack("<iii", kind, roads.feature_id[i], len(points)),
            points.T.astype("<f4").tobytes(),
            NO_VALUES,
        ]
    return b"".join(blocks)
