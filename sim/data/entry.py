"""States what the manifest of a store says of a scenario, without its arrays.

Queries choose scenarios by it, `drivetrain data summary` draws it, and a bank that
streams a store learns from it how much room it needs.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import DRIVING_LANES, SAME_LEVEL, ObjectType
from . import bank, light_check
from .packed import JOINED, Packed
from .planar_log import PlanarLog, planar_log

SAME_PLACE = 2.5  # metres between centres: two road users who cross or share a way
MOVED = 1.0  # metres that one gets away who moves: parked cars jitter by less
CROSSING_ANGLE = np.radians(30.0)  # between lanes that cross, at least
CROSSING_REACH = 6.0  # metres from the ego to a lane that crosses its own
STEPS_APART = 2  # of the log, for the search of encounters


@dataclasses.dataclass(frozen=True, kw_only=True)
class Entry:
    """What is known of one packed scenario."""

    scenario_id: str
    dataset: str
    ego_source: str
    route_source: str
    assumptions: str  # what the format did not say
    num_steps: int
    current_step: int
    num_vehicles: int
    num_pedestrians: int
    num_cyclists: int
    num_others: int
    num_still: int  # objects whose log is one place
    num_lights: int
    red_crossings: int  # vehicles that pass a light at red, and
    green_crossings: int  # at green
    num_stop_signs: int
    num_paths: int
    num_edges: int  # vertices of road edges
    num_map_points: int  # as the file has them
    num_vertices: int  # of the map in the bank
    ego_distance: float  # metres that the ego gets away from its current place
    ego_speed: float  # mean over the simulated steps [m/s]
    encounter: float | None  # seconds between the ego and another at one place
    is_at_junction: bool  # a lane crosses the ego's way
    is_goal_feasible: bool  # the ego's log crosses no road edge (N app. E)
    num_bytes: int  # in the bank
    num_index_dropped: int  # candidates that did not fit into the index of road edges
    quantum: float  # metres between places that can be told apart; 0 for float32
    rows: dict[str, int]  # in each table of the bank

    @property
    def num_objects(self) -> int:
        """How many objects there are."""
        return sum(
            (
                self.num_vehicles,
                self.num_pedestrians,
                self.num_cyclists,
                self.num_others,
            )
        )


def entry_of(packed: Packed) -> Entry:
    """Looks at a packed scenario."""
    kinds = np.bincount(np.maximum(packed.object_type, 0), minlength=5)
    known = kinds[[ObjectType.VEHICLE, ObjectType.PEDESTRIAN, ObjectType.CYCLIST]]
    log = planar_log(packed)
    ego = log.valid[0] & (np.arange(packed.num_steps) >= packed.current_step)
    way = log.xy[0, ego]
    red, green = light_check.crossings(packed, log)
    return Entry(
        scenario_id=packed.scenario_id,
        dataset=packed.dataset,
        ego_source=packed.ego_source,
        route_source=packed.route_source,
        assumptions=packed.assumptions,
        num_steps=packed.num_steps,
        current_step=packed.current_step,
        num_vehicles=int(known[0]),
        num_pedestrians=int(known[1]),
        num_cyclists=int(known[2]),
        num_others=int(kinds.sum() - known.sum()),
        num_still=int(packed.is_still.sum()),
        num_lights=len(packed.light_xyz),
        red_crossings=red,
        green_crossings=green,
        num_stop_signs=packed.num_stop_signs,
        num_paths=len(packed.path_on_route),
        num_edges=len(packed.edge_normal),
        num_map_points=packed.num_map_points,
        num_vertices=len(packed.vertices),
        ego_distance=round(float(np.linalg.norm(way - way[0], axis=1).max()), 2),
        ego_speed=round(float(np.linalg.norm(log.velocity[0, ego], axis=1).mean()), 2),
        encounter=_encounter(log, packed),
        is_at_junction=_is_at_junction(way, log.height[0, ego], packed),
        is_goal_feasible=bool(packed.goal_feasible[0]),
        num_bytes=bank.num_bytes(packed),
        num_index_dropped=packed.num_index_dropped,
        quantum=packed.quantum if packed.poses.dtype == np.int16 else 0.0,
        rows=packed.rows,
    )


def _encounter(log: PlanarLog, packed: Packed) -> float | None:
    """Returns the least time between the ego and a moving other at one place [s].

    It is the least |t - u| over simulated steps t of the ego and u of another road user
    who moves, at which their centres are within 2.5 m on one level: small where they
    cross, merge or follow closely (post-encroachment time, Allen et al. 1978). None
    where they share no place. One moves who gets 1 m away from where its log begins.
    """
    steps = np.arange(packed.current_step, packed.num_steps, STEPS_APART)
    moves = np.flatnonzero(_moves(log)[1:]) + 1
    valid = log.valid[moves][:, steps]
    other, height = log.xy[moves][:, steps], log.height[moves][:, steps]
    own = log.valid[0, steps]
    gap = other[:, :, None] - log.xy[0, steps][own][None, None]
    rise = height[:, :, None] - log.height[0, steps][own][None, None]
    meets = (gap[..., 0] ** 2 + gap[..., 1] ** 2 <= SAME_PLACE**2) & valid[..., None]
    meets &= np.abs(rise) <= SAME_LEVEL
    apart = np.abs(steps[:, None] - steps[own][None])[None]
    found = apart[0][meets.any(axis=0)] if meets.any() else np.zeros(0)
    return round(float(found.min()) * packed.dt, 2) if len(found) else None


def _moves(log: PlanarLog) -> Bool[np.ndarray, " objects"]:
    """Tells who gets away from where its log begins."""
    first = log.xy[np.arange(len(log.valid)), log.valid.argmax(axis=1)]
    away = np.linalg.norm(log.xy - first[:, None], axis=-1)
    return np.where(log.valid, away, 0.0).max(axis=1) >= MOVED


def _is_at_junction(
    way: Float[np.ndarray, "steps 2"],
    height: Float[np.ndarray, " steps"],
    packed: Packed,
) -> bool:
    """Tells whether a driving lane crosses the ego's way.

    It does where one passes within 6 m of the ego, on its level, and its direction is
    between 30 and 150 degrees from that of the way. An ego that stands has no way.
    """
    points, height = way[::5], height[::5]
    moves = np.diff(points, axis=0, append=points[-1:])
    far = np.hypot(*moves.T) > 0.5
    points, height, moves = points[far], height[far], moves[far]
    joined = packed.vertex_tag >= JOINED
    kind = packed.vertex_tag % JOINED
    first = np.flatnonzero(joined & np.isin(kind, DRIVING_LANES))
    if not len(points) or not len(first):
        return False
    xyz = packed.metres(packed.vertices)
    start, along = xyz[first, :2], (xyz[first + 1] - xyz[first])[:, :2]
    is_level = np.abs(xyz[first, 2] - height[:, None]) <= SAME_LEVEL
    squared = np.maximum((along**2).sum(axis=1), 1e-9)
    offset = points[:, None] - start[None]
    share = np.clip((offset * along).sum(axis=-1) / squared, 0.0, 1.0)
    near = ((offset - share[..., None] * along) ** 2).sum(axis=-1) <= CROSSING_REACH**2
    cosine = np.abs((moves[:, None] * along).sum(axis=-1)) / (
        np.hypot(*moves.T)[:, None] * np.sqrt(squared)
    )
    return bool((near & is_level & (cosine < np.cos(CROSSING_ANGLE))).any())
