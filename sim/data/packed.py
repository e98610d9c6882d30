"""States what a packed scenario is: the form of the store and of the device.

`pack` makes it, `store` keeps it, `bank` lays many out on a device.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Integer, Shaped

JOINED = 32  # added to the map type of a vertex from which a segment leads on
LIGHT_VALID = 16  # added to the state of a light that was seen
QUANTUM = 0.01  # metres, and metres per second
YAW_QUANTUM = 2 * np.pi / 2**16  # radians
LIMIT_QUANTUM = 0.25  # metres per second, of speed limits
LISTED = 8  # candidates in a row of `index_blocks`: so many fewer rows to number


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Packed:
    """A packed scenario.

    Objects are sorted: the ego first, then those the data set marks, then by their
    least distance to the ego. Coordinates are `centre + quantum * stored`, in the
    scenario's frame; adding `origin` gives the file's.
    """

    scenario_id: str
    dataset: str
    ego_source: str
    route_source: str
    assumptions: str  # what the format did not say; empty where it says all
    dt: float
    current_step: int
    num_steps: int
    origin: Float[np.ndarray, " 3"]
    centre: Float[np.ndarray, " 3"]
    quantum: float
    object_id: Integer[np.ndarray, " objects"]
    object_type: Integer[np.ndarray, " objects"]
    object_size: Float[np.ndarray, "objects 3"]
    goal_feasible: Bool[np.ndarray, " objects"]  # the log crosses no road edge
    valid_bits: Integer[np.ndarray, "objects words"]  # bit t % 32 of word t // 32
    is_still: Bool[np.ndarray, " objects"]  # the log has one row for all valid steps
    poses: np.ndarray  # [rows, 3], object after object, else a row for each valid step
    turns: np.ndarray  # [rows, 3]: yaw and velocity
    num_map_points: int  # of the file's map, before it was simplified
    vertices: np.ndarray  # [vertices, 3], first road edges, then stop signs
    vertex_tag: Integer[np.ndarray, " vertices"]  # map type, plus JOINED
    edge_normal: np.ndarray  # [edge vertices]: direction towards the road
    num_stop_signs: int  # whose vertices follow those of the edges
    stop_yaw: np.ndarray  # [stop signs]: direction of the lane that it stops
    stop_has_lane: Bool[np.ndarray, " stop_signs"]  # whether the map tells it
    index_corner: Float[np.ndarray, " 2"]
    index_shape: Integer[np.ndarray, " 2"]
    index_nodes: Integer[np.ndarray, " nodes"]
    index_blocks: Integer[np.ndarray, "rows candidates"]  # lists, LISTED to a row
    num_index_dropped: int
    tile_corner: Float[np.ndarray, " 2"]
    tile_shape: Integer[np.ndarray, " 2"]
    tile_starts: Integer[np.ndarray, " tiles_plus_1"]
    tile_pieces: Integer[np.ndarray, " vertices"]
    tile_reach: float
    light_xyz: np.ndarray  # [lights, 3]
    light_state: Integer[np.ndarray, "lights steps"]  # state, plus LIGHT_VALID
    light_yaw: np.ndarray  # [lights]: direction of the lane at the stop point
    light_has_lane: Bool[np.ndarray, " lights"]  # whether the map has the lane
    path_vertices: np.ndarray  # [path vertices, 2]
    path_arc: Float[np.ndarray, " path_vertices"]  # along the path [m]
    path_limit: Integer[np.ndarray, " path_vertices"]  # speed limit ahead, 0 for none
    path_offset: Integer[np.ndarray, " paths_plus_1"]
    path_on_route: Bool[np.ndarray, " paths"]
    path_log_arc: Float[np.ndarray, "paths 2"]  # of the first and last logged position

    def metres(
        self, stored: Shaped[np.ndarray, "*any axes"]
    ) -> Float[np.ndarray, "*any axes"]:
        """Returns stored places, of two axes or three, in the scenario's frame [m]."""
        centre = self.centre[: stored.shape[-1]]
        return centre + self.quantum * stored.astype(np.float64)

    def radians(self, stored: Shaped[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Returns stored angles [rad]."""
        unit = YAW_QUANTUM if stored.dtype == np.int16 else 1.0
        return unit * stored.astype(np.float64)

    def speeds(self, stored: Shaped[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Returns stored velocities [m/s]."""
        unit = QUANTUM if stored.dtype == np.int16 else 1.0
        return unit * stored.astype(np.float64)

    @property
    def rows(self) -> dict[str, int]:
        """How many rows the scenario has in each kind of table of the bank."""
        return {
            "objects": len(self.object_id),
            "rows": len(self.poses),
            "vertices": len(self.vertices),
            "edges": len(self.edge_normal),
            "stop_signs": self.num_stop_signs,
            "nodes": len(self.index_nodes),
            "blocks": len(self.index_blocks),
            "tiles": len(self.tile_starts),
            "lights": len(self.light_xyz),
            "path_vertices": len(self.path_vertices),
            "paths": len(self.path_on_route),
        }
