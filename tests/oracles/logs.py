"""Oracle of what a whole log shows, in plain NumPy: boxes, edges, turns."""

import numpy as np

from drivetrain.sim.scenario import EDGES, Scenario


def corners(xy: np.ndarray, yaw: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Returns the corners of boxes in order round them."""
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)[..., None, :]
    left = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)[..., None, :]
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    return (
        xy[..., None, :]
        + signs[:, :1] * size[..., None, :1] * ahead
        + signs[:, 1:] * size[..., None, 1:2] * left
    )


def boxes(scenario: Scenario) -> np.ndarray:
    """Returns the corners of all objects at all steps, about the scenario's origin."""
    tracks = scenario.tracks
    size = np.broadcast_to(tracks.size[:, None], tracks.xyz.shape)
    return corners(tracks.xyz[..., :2] - scenario.origin[:2], tracks.yaw, size)


def overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Tells which of two runs of boxes share some point: no edge separates them."""
    apart = np.zeros(len(a), bool)
    for edges in (a, b):
        for k in range(4):
            edge = edges[:, (k + 1) % 4] - edges[:, k]
            outward = np.stack([edge[:, 1], -edge[:, 0]], axis=-1)
            heights = [
                np.einsum("tki,ti->tk", box - edges[:, k : k + 1], outward)
                for box in (a, b)
            ]
            mine, other = heights if edges is a else heights[::-1]
            apart |= other.min(axis=1) >= mine.max(axis=1)
    return ~apart


def overlapping_pairs(scenario: Scenario) -> list[tuple[int, int]]:
    """Returns which objects ever overlap in the log."""
    box, valid = boxes(scenario), scenario.tracks.valid
    center = box.mean(axis=2)
    reach = np.linalg.norm(scenario.tracks.size[:, :2], axis=1) / 2
    found = []
    for i in range(len(box)):
        for j in range(i):
            gap = np.linalg.norm(center[i] - center[j], axis=1)
            near = valid[i] & valid[j] & (gap < reach[i] + reach[j])
            if near.any() and overlap(box[i][near], box[j][near]).any():
                found.append((j, i))
    return found


def beyond_edge(scenario: Scenario, xy: np.ndarray) -> np.ndarray:
    """Returns how far points lie right of the nearest road edge; left is negative."""
    runs = [
        scenario.roads.points_of(i)[:, :2] - scenario.origin[:2]
        for i in range(scenario.roads.num_features)
        if scenario.roads.map_type[i] in EDGES
    ]
    begin = np.concatenate([run[:-1] for run in runs])
    edge = np.concatenate([np.diff(run, axis=0) for run in runs])
    near = (np.abs(begin[:, None] - xy[None, ::8]).max(axis=2) < 25.0).any(axis=1)
    begin, edge = begin[near], edge[near]
    to_point = xy[:, None] - begin
    along = np.sum(to_point * edge, axis=-1) / np.sum(edge**2, axis=-1)
    gap = to_point - np.clip(along, 0, 1)[..., None] * edge
    distance = np.linalg.norm(gap, axis=-1)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(xy))
    # At a vertex, the normals of all edges that end there count.
    deciding = distance <= distance[rows, nearest][:, None] + 1e-6
    right = np.stack([edge[:, 1], -edge[:, 0]], axis=-1)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    normal = deciding @ right
    return distance[rows, nearest] * np.sign(np.sum(gap[rows, nearest] * normal, -1))


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Returns the same directions as angles in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
