"""Packs a scenario into the compact form that the store keeps and the device holds.

Polylines are simplified, coordinates become 16-bit numbers, only valid object-steps are
kept, and what is constant in the scenario is computed here once: the index of the road
edges, the side of each edge vertex, arc lengths along the ego's paths.
"""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from ..scenario import (
    EDGES,
    Lights,
    MapType,
    Paths,
    Polylines,
    Scenario,
    ScenarioError,
    Tracks,
)
from . import edge_index, edge_sides, log_rows, routes, tiles, timeline as timelines
from .feasibility import goal_feasible
from .lane_directions import lane_directions, stop_sign_directions
from .packed import (
    JOINED,
    LIGHT_VALID,
    LIMIT_QUANTUM,
    LISTED,
    QUANTUM,
    YAW_QUANTUM,
    Packed,
)
from .parts import seen_lights
from .simplify import kept_points
from .timeline import Timeline

MAX_SIMPLIFY = 1.0  # metres: beyond, road edges move into lanes
_MAX_INT16 = 2**15 - 1
Fields = dict[str, Any]  # of a packed scenario, by name


@dataclasses.dataclass(frozen=True, kw_only=True)
class PackConfig:
    """How scenarios are packed."""

    simplify: float = 0.03  # greatest deviation of simplified polylines [m]
    quantize: bool = True  # 16-bit numbers; else float32 and no simplification
    timeline: Timeline = (
        timelines.DEFAULT
    )  # how logs that are read come to steps of 0.1 s

    def __post_init__(self) -> None:
        """Checks the tolerance.

        Raises:
            ValueError: if it is negative, or so wide that roads lose their shape.
        """
        if not 0 <= self.simplify <= MAX_SIMPLIFY:
            raise ValueError(
                f"simplify must be a length from 0 to {MAX_SIMPLIFY:g} m, got "
                f"{self.simplify}."
            )


def pack(scenario: Scenario, config: PackConfig) -> Packed:
    """Packs a scenario that passed `scenario.check`; finds its paths if it has none.

    Raises:
        ScenarioError: if it has more road edges, or a larger map, than can be numbered.
    """
    paths = routes.paths_of(scenario)
    lights = seen_lights(scenario.lights)
    centre, quantum = _coordinates(scenario, lights, paths, config.quantize)
    scale = _Scale(scenario.origin, centre, quantum, config.quantize)
    drawn = _drawn_map(scenario, scale, config)
    return Packed(
        scenario_id=scenario.scenario_id,
        dataset=scenario.dataset,
        ego_source=scenario.ego_source,
        route_source=paths.source,
        assumptions="; ".join(scenario.assumptions),
        dt=scenario.dt,
        current_step=scenario.current_step,
        num_steps=scenario.num_steps,
        origin=scenario.origin,
        centre=centre.astype(np.float32),
        quantum=quantum,
        num_map_points=len(scenario.roads.xyz),
        **drawn,
        **_objects(scenario, scale, drawn),
        **_lights(lights, scenario.roads, scale),
        **_routes(paths, scenario, scale, config),
    )


def _drawn_map(scenario: Scenario, scale: "_Scale", config: PackConfig) -> Fields:
    """Returns the map, its stop signs and what finds its edges and pieces."""
    vertices, tag = _map(scenario.roads, scale, config)
    num_edge_vertices = int(np.isin(tag & (JOINED - 1), EDGES).sum())
    edges = scale.in_scene(vertices[:num_edge_vertices])
    joined = tag[:num_edge_vertices] >= JOINED
    if len(edges) > edge_index.MAX_VERTICES:
        raise ScenarioError(
            f"{len(edges):,} vertices of road edges, at most "
            f"{edge_index.MAX_VERTICES:,} fit; cut the map"
        )
    index = edge_index.build(edges, joined)
    tiling = tiles.build(scale.in_scene(vertices), tag >= JOINED)
    stop_yaw, stop_has_lane = stop_sign_directions(scenario.roads, scenario.lane_links)
    return Fields(
        vertices=vertices,
        vertex_tag=tag,
        num_stop_signs=len(stop_yaw),
        stop_yaw=_encode_yaw(stop_yaw, config.quantize),
        stop_has_lane=stop_has_lane,
        edge_normal=_encode_yaw(edge_sides.normals(edges, joined), config.quantize),
        index_corner=index.corner.astype(np.float32),
        index_shape=index.shape,
        index_nodes=index.nodes,
        index_blocks=_in_rows(index.blocks.astype(np.uint16)),
        num_index_dropped=index.num_dropped,
        tile_corner=tiling.corner,
        tile_shape=tiling.shape,
        tile_starts=tiling.starts,
        tile_pieces=tiling.pieces,
        tile_reach=tiling.reach,
    )


def _objects(scenario: Scenario, scale: "_Scale", drawn: Fields) -> Fields:
    """Returns the objects and their logs, on the map that was drawn."""
    tracks = scenario.tracks
    order = _object_order(tracks, scenario.ego_index)
    valid = tracks.valid[order]
    counts = valid.sum(axis=1)
    poses = scale.encode(tracks.xyz[order][valid])
    turns = _encode_turns(
        tracks.yaw[order][valid], tracks.velocity[order][valid], scale.quantize
    )
    is_still = log_rows.still_objects(np.concatenate([poses, turns], axis=1), counts)
    rows = log_rows.kept_rows(is_still, counts)
    num_edge_vertices = len(drawn["edge_normal"])
    return Fields(
        object_id=tracks.object_id[order].astype(np.int64),
        object_type=tracks.object_type[order].astype(np.int8),
        object_size=tracks.size[order].astype(np.float32),
        goal_feasible=goal_feasible(
            tracks.xyz[order] - scenario.origin,
            tracks.yaw[order],
            tracks.size[order],
            valid,
            scale.in_scene(drawn["vertices"][:num_edge_vertices]),
            drawn["vertex_tag"][:num_edge_vertices] >= JOINED,
        ),
        valid_bits=log_rows.valid_bits(valid),
        is_still=is_still,
        poses=poses[rows],
        turns=turns[rows],
    )


def _lights(lights: Lights, roads: Polylines, scale: "_Scale") -> Fields:
    yaw, has_lane = lane_directions(lights.lane_id, lights.xyz, roads)
    return Fields(
        light_xyz=scale.encode(lights.xyz),
        light_state=(lights.state + LIGHT_VALID * lights.valid).astype(np.uint8),
        light_yaw=_encode_yaw(yaw, scale.quantize),
        light_has_lane=has_lane,
    )


def _routes(
    paths: Paths, scenario: Scenario, scale: "_Scale", config: PackConfig
) -> Fields:
    vertices, offset, limit = _paths(paths, scale, config)
    arc, log_arc = _arc_lengths(scale.decode(vertices), offset, _logged_ends(scenario))
    return Fields(
        path_vertices=vertices[:, :2],
        path_arc=arc.astype(np.float32),
        path_limit=limit,
        path_offset=offset.astype(np.int32),
        path_on_route=paths.on_route,
        path_log_arc=log_arc.astype(np.float32),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class _Scale:
    """Turns coordinates of the file into stored numbers and back."""

    origin: Float[np.ndarray, " 3"]
    centre: Float[np.ndarray, " 3"]  # from the origin
    quantum: float
    quantize: bool

    def encode(self, xyz):
        offset = xyz - (self.origin + self.centre)
        if not self.quantize:
            return offset.astype(np.float32)
        return np.round(offset / self.quantum).astype(np.int16)

    def decode(self, stored):
        return self.origin + self.centre + self.quantum * stored.astype(np.float64)

    def in_scene(self, stored):
        """Returns places in the scenario's frame."""
        return self.decode(stored) - self.origin


def _coordinates(scenario: Scenario, lights: Lights, paths: Paths, quantize: bool):
    """Returns the centre of all coordinates and the quantum that makes them fit."""
    if not quantize:
        return np.zeros(3), 1.0
    points = np.concatenate(
        [
            scenario.tracks.xyz[scenario.tracks.valid],
            scenario.roads.xyz,
            lights.xyz,
            paths.xyz,
        ]
    )
    low, high = (
        points.min(axis=0) - scenario.origin,
        points.max(axis=0) - scenario.origin,
    )
    centre = ((low + high) / 2).astype(np.float32).astype(np.float64)
    quantum = QUANTUM
    while (high - low).max() / 2 + 1 > quantum * _MAX_INT16:  # wider than 655 m
        quantum *= 2
    return centre, quantum


def _object_order(tracks: Tracks, ego_index: int):
    """Sorts objects so that a prefix holds those that matter most to the ego."""
    both = tracks.valid & tracks.valid[ego_index]
    offset = tracks.xyz[..., :2] - tracks.xyz[ego_index, :, :2]
    distance = np.where(both, np.linalg.norm(offset, axis=-1), np.inf).min(axis=1)
    distance[tracks.is_of_interest] = -1
    distance[ego_index] = -2
    order = np.argsort(distance, kind="stable")
    return order[tracks.valid[order].any(axis=1)]


def _encode_yaw(yaw, quantize: bool):
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    if not quantize:
        return wrapped.astype(np.float32)
    return np.round(wrapped / YAW_QUANTUM).astype(np.int32).astype(np.int16)


def _encode_turns(yaw, velocity, quantize: bool):
    if quantize:
        limit = QUANTUM * _MAX_INT16
        velocity = np.round(np.clip(velocity, -limit, limit) / QUANTUM).astype(np.int16)
    stored_yaw = _encode_yaw(yaw, quantize)[:, None]
    return np.concatenate([stored_yaw, velocity.astype(stored_yaw.dtype)], axis=1)


def _in_rows(candidates):
    """Lays the lists of the index out in rows, the last one filled up with zeros."""
    return np.pad(candidates, (0, -len(candidates) % LISTED)).reshape(-1, LISTED)


def _map(roads: Polylines, scale: _Scale, config: PackConfig):
    """Returns the stored vertices of the map and their tags, as `Packed` sorts them."""
    lengths = np.diff(roads.offset)
    is_edge = np.isin(roads.map_type, EDGES)
    is_sign = roads.map_type == MapType.STOP_SIGN
    features = np.lexsort([~is_sign, ~is_edge])
    features = features[lengths[features] > 0]
    every = np.arange(len(roads.xyz))
    points = np.concatenate(
        [every[roads.offset[i] : roads.offset[i + 1]] for i in features]
    )
    feature = np.repeat(np.arange(len(features)), lengths[features])
    if config.quantize:
        offset = np.searchsorted(feature, np.arange(len(features) + 1))
        kept = kept_points(roads.xyz[points], offset, config.simplify, tiles.MAX_PIECE)
        points, feature = points[kept], feature[kept]
    stored = scale.encode(roads.xyz[points])
    repeats = np.append(False, (feature[1:] == feature[:-1]) & _same(stored))
    feature, stored = feature[~repeats], stored[~repeats]
    joined = np.append(feature[1:] == feature[:-1], False)
    tag = roads.map_type[features][feature] + JOINED * joined
    return stored, tag.astype(np.uint8)


def _same(stored):
    return (stored[1:] == stored[:-1]).all(axis=1)


def _paths(paths: Paths, scale: _Scale, config: PackConfig):
    stored = scale.encode(paths.xyz)
    limit = np.where(paths.is_limited, paths.speed_limit / LIMIT_QUANTUM, 0.0)
    limit = np.clip(np.round(limit), paths.is_limited, 255).astype(np.uint8)
    if not config.quantize:
        return stored, paths.offset, limit
    changes = np.diff(limit, prepend=limit[:1]) != 0
    kept = kept_points(paths.xyz, paths.offset, config.simplify, always=changes)
    before = np.concatenate([[0], np.cumsum(kept)])
    return stored[kept], before[paths.offset], limit[kept]


def _logged_ends(scenario: Scenario) -> Float[np.ndarray, "2 2"]:
    steps = np.flatnonzero(scenario.tracks.valid[scenario.ego_index])
    return scenario.tracks.xyz[scenario.ego_index, steps[[0, -1]], :2]


def _arc_lengths(vertices, offset, points):
    """Returns the arc length of each path vertex, and of points on each path."""
    xy = vertices[:, :2]
    arc = np.zeros(len(xy))
    nearest_arc = np.zeros((len(offset) - 1, len(points)))
    for i in range(len(offset) - 1):
        path = slice(offset[i], offset[i + 1])
        along = np.diff(xy[path], axis=0)
        length = np.linalg.norm(along, axis=1)
        arc[path] = np.append(0, np.cumsum(length))
        if not len(along):
            continue
        from_start = points[:, None] - xy[path][:-1]
        share = (from_start * along).sum(-1) / np.where(length > 0, length**2, 1)
        share = np.clip(share, 0, 1)
        distance = np.linalg.norm(from_start - share[..., None] * along, axis=-1)
        segment = distance.argmin(axis=1)
        chosen = share[np.arange(len(points)), segment]
        nearest_arc[i] = arc[path][segment] + chosen * length[segment]
    return arc, nearest_arc
