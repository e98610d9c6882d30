"""Turns what road users did into the tracks of a log."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...scenario import DT, ObjectType
from . import mover as movers, steering
from .drivers import Drivers
from .lines import snap
from .mover import Mover
from .network import Network
from .profile import BIKE_WIDTH
from .traffic import Drive

ROOM = 0.05  # metres of each box that others must not touch
EGO_ROOM = 0.3  # metres: a bicycle that replays the ego's log leaves it so far
CYCLIST_SIDE = 0.55  # metres from the right of the lane to one who rides in it


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanarTracks:
    """A log in the plane of the town; where not valid, values mean nothing."""

    object_type: Int[np.ndarray, " objects"]  # ObjectType
    size: Float[np.ndarray, "objects 3"]  # length, width, height [m]
    xy: Float[np.ndarray, "objects steps 2"]
    yaw: Float[np.ndarray, "objects steps"]
    velocity: Float[np.ndarray, "objects steps 2"]
    valid: Bool[np.ndarray, "objects steps"]

    def of(self, rows: Int[np.ndarray, " kept"]) -> "PlanarTracks":
        """Returns some of the objects, in the order of the rows."""
        return PlanarTracks(
            **{
                field.name: getattr(self, field.name)[rows]
                for field in dataclasses.fields(self)
            }
        )


def tracks(road_users: list[Mover]) -> PlanarTracks:
    """Gathers road users."""
    return PlanarTracks(
        object_type=np.array([int(user.object_type) for user in road_users]),
        size=np.stack([user.size for user in road_users]),
        xy=np.stack([user.xy for user in road_users]),
        yaw=np.stack([user.yaw for user in road_users]),
        velocity=np.stack([user.velocity for user in road_users]),
        valid=np.stack([user.is_there for user in road_users]),
    )


def driven(
    generator: np.random.Generator,
    network: Network,
    drivers: Drivers,
    drive: Drive,
    first: int,
) -> list[Mover]:
    """Returns the drivers from a step on, each with its own errors of steering."""
    station = drive.station[first:].T
    travelled = np.cumsum(drive.speed[first:].T * DT, axis=1)
    left, slope = steering.steer(travelled, generator)
    left, slope = left + drive.left[first:].T, slope + drive.slope[first:].T
    lanes = network.town.lanes
    ways: dict[tuple[int, ...], movers.Way] = {}
    result = []
    for row in range(len(drivers.desired)):
        used = drive.way[first:, row]
        side = np.zeros(len(used))
        if drivers.is_cyclist[row]:
            side -= _cyclist_side(network, drive.ways[int(used[0])][0])
        parts = []
        for name in np.unique(used).tolist():
            run = drive.ways[name]
            if run not in ways:
                ways[run] = movers.way([lanes[i].line for i in run])
            at = used == name
            parts.append(
                movers.along(
                    ways[run],
                    station[row, at],
                    drive.speed[first:, row][at],
                    (left[row] + side)[at],
                    slope[row, at],
                )
            )
        xy, yaw, velocity = (np.concatenate(v) for v in zip(*parts, strict=True))
        kind = ObjectType.CYCLIST if drivers.is_cyclist[row] else ObjectType.VEHICLE
        result.append(
            Mover(
                object_type=kind,
                size=drivers.size[row],
                xy=snap(xy),
                yaw=snap(yaw),
                velocity=snap(velocity),
                is_there=drive.is_there[first:, row],
            )
        )
    return result


def _cyclist_side(network: Network, lane: int) -> float:
    """Returns how far right of a lane's middle a cyclist rides [m]."""
    number = int(np.searchsorted(network.town.first_lane, lane, side="right")) - 1
    has_bike_lane = any(
        other.map_type == 3 for other in network.town.pieces[number].lanes
    )
    half = network.town.lanes[lane].width / 2
    return half + BIKE_WIDTH / 2 if has_bike_lane else half - CYCLIST_SIDE


def overlaps_earlier(tracks: PlanarTracks) -> Bool[np.ndarray, " objects"]:
    """Tells whose box ever overlaps that of a kept one before it (separating axes)."""
    half = tracks.size[:, :2] / 2
    radius = np.sqrt(half[:, 0] ** 2 + half[:, 1] ** 2)
    rows, columns = np.triu_indices(len(half), 1)
    low = np.where(tracks.valid[..., None], tracks.xy, np.inf).min(axis=1)
    high = np.where(tracks.valid[..., None], tracks.xy, -np.inf).max(axis=1)
    reach = radius[rows] + radius[columns]
    meet = (low[rows] < high[columns] + reach[:, None]).all(axis=1)
    meet &= (low[columns] < high[rows] + reach[:, None]).all(axis=1)
    rows, columns, reach = rows[meet], columns[meet], reach[meet]
    gap = tracks.xy[columns] - tracks.xy[rows]
    near = gap[..., 0] ** 2 + gap[..., 1] ** 2 < reach[:, None] ** 2
    pair, step = np.nonzero(near & tracks.valid[rows] & tracks.valid[columns])
    i, j = rows[pair], columns[pair]
    overlap = _overlap(tracks, (i, j), step, gap[pair, step])
    left_out = np.zeros(len(half), bool)
    for first, second in sorted(set(zip(i[overlap], j[overlap], strict=True))):
        left_out[second] |= not left_out[first]
    return left_out


def _overlap(
    tracks: PlanarTracks,
    pair: tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]],
    step: Int[np.ndarray, " pairs"],
    gap: Float[np.ndarray, "pairs 2"],
) -> Bool[np.ndarray, " pairs"]:
    half = tracks.size[:, :2] / 2 + ROOM
    half[0] += EGO_ROOM
    i, j = pair
    turn = tracks.yaw[i, step] - tracks.yaw[j, step]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    overlap = np.ones(len(i), bool)
    for own, other in ((i, j), (j, i)):
        cos, sin = np.cos(tracks.yaw[own, step]), np.sin(tracks.yaw[own, step])
        ahead = np.abs(gap[:, 0] * cos + gap[:, 1] * sin)
        aside = np.abs(gap[:, 1] * cos - gap[:, 0] * sin)
        overlap &= ahead < half[own, 0] + c * half[other, 0] + s * half[other, 1]
        overlap &= aside < half[own, 1] + s * half[other, 0] + c * half[other, 1]
    return overlap
