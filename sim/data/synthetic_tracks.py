"""Turns road users on their lines into the tracks of a log."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ..scenario import ObjectType
from .synthetic_experts import Route

SIGHT = 80.0  # metres from the ego at which others enter the log


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mover:
    """One road user on its line."""

    object_type: ObjectType
    size: Float[np.ndarray, " 3"]  # length, width, height [m]
    route: Route
    station: Float[np.ndarray, " steps"]  # metres
    speed: Float[np.ndarray, " steps"]  # metres per second
    left: Float[np.ndarray, " steps"]  # metres left of the line
    slope: Float[np.ndarray, " steps"]  # of that, along the line


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanarTracks:
    """The log in the local plane of the site."""

    object_type: Int[np.ndarray, " objects"]  # ObjectType
    xy: Float[np.ndarray, "objects steps 2"]
    yaw: Float[np.ndarray, "objects steps"]
    velocity: Float[np.ndarray, "objects steps 2"]
    valid: Bool[np.ndarray, "objects steps"]
    size: Float[np.ndarray, "objects 3"]


def log(movers: list[Mover]) -> PlanarTracks:
    """Logs the road users; the first is the ego.

    Others enter the log when they first come within 80 m of the ego and leave it where
    their line ends. Those who overlap one before them in the list are left out, so that
    no log shows a collision.
    """
    poses = [_poses(mover) for mover in movers]
    xy, yaw, velocity = (np.stack(values) for values in zip(*poses, strict=True))
    size = np.stack([mover.size for mover in movers])
    distance = np.linalg.norm(xy - xy[:1], axis=-1)
    valid = np.maximum.accumulate(distance < SIGHT, axis=1)
    station = np.stack([mover.station for mover in movers])
    end = np.array([mover.route.station[-1] for mover in movers])
    valid &= station + size[:, :1] / 2 <= end[:, None]
    kept = valid.any(axis=1) & ~_overlaps_earlier(xy, yaw, size, valid)
    return PlanarTracks(
        object_type=np.array([int(mover.object_type) for mover in movers])[kept],
        xy=xy[kept],
        yaw=yaw[kept],
        velocity=velocity[kept],
        valid=valid[kept],
        size=size[kept],
    )


def _poses(mover: Mover) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns position, yaw and velocity.

    With station s, curvature k and the distance d(s) left of the line, the velocity is
    s' (1 - k d) along the line and s' d'(s) across it.
    """
    route, station = mover.route, mover.station
    x, y, yaw, curvature = (
        np.interp(station, route.station, values)
        for values in (*route.xy.T, route.yaw, route.curvature)
    )
    left, along, across = mover.left, 1 - curvature * mover.left, mover.slope
    heading = yaw + np.arctan2(across, along)
    speed = mover.speed * np.hypot(along, across)
    return (
        np.stack([x - left * np.sin(yaw), y + left * np.cos(yaw)], axis=-1),
        heading,
        speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1),
    )


def _overlaps_earlier(
    xy: Float[np.ndarray, "objects steps 2"],
    yaw: Float[np.ndarray, "objects steps"],
    size: Float[np.ndarray, "objects 3"],
    valid: Bool[np.ndarray, "objects steps"],
) -> Bool[np.ndarray, " objects"]:
    """Tells whose box ever overlaps that of a kept one before it (separating axes)."""
    half = size[:, :2] / 2
    radius = np.hypot(half[:, 0], half[:, 1])
    rows, columns = np.triu_indices(len(xy), 1)
    gap = xy[columns] - xy[rows]
    reach = (radius[rows] + radius[columns])[:, None]
    near = np.einsum("pti,pti->pt", gap, gap) < reach**2
    pair, step = np.nonzero(near & valid[rows] & valid[columns])
    i, j, gap = rows[pair], columns[pair], gap[pair, step]

    overlap = np.ones(len(pair), bool)
    c, s = np.cos(yaw[i, step] - yaw[j, step]), np.sin(yaw[i, step] - yaw[j, step])
    c, s = np.abs(c), np.abs(s)
    for own, other in ((i, j), (j, i)):
        cos, sin = np.cos(yaw[own, step]), np.sin(yaw[own, step])
        ahead = np.abs(gap[:, 0] * cos + gap[:, 1] * sin)
        aside = np.abs(gap[:, 1] * cos - gap[:, 0] * sin)
        overlap &= ahead < half[own, 0] + c * half[other, 0] + s * half[other, 1]
        overlap &= aside < half[own, 1] + s * half[other, 0] + c * half[other, 1]

    left_out = np.zeros(len(xy), bool)
    for first, second in sorted(set(zip(i[overlap], j[overlap], strict=True))):
        left_out[second] |= not left_out[first]
    return left_out
