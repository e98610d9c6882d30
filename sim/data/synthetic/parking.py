"""Parks cars: at curbs, in car parks and on lots beside the roads."""

import numpy as np
from jaxtyping import Float

from ...scenario import ObjectType
from .lines import Line, Pose, ahead, headings, placed, stations
from .mover import Mover, standing
from .town import Town

CURB_SPACING = (6.2, 22.0)  # metres from middle to middle
LOT_WIDTH = 2.9  # metres from car to car on a lot
LOT_DISTANCE = (5.0, 36.0)  # metres from a footway to a lot
CLEAR = 7.0  # metres between a lot and any lane
REACH = 90.0  # metres from the origin


def parked(generator: np.random.Generator, town: Town, num_steps: int) -> list[Mover]:
    """Draws the parked cars of a town."""
    share = generator.uniform(0.2, 0.95)
    poses: list[Pose] = []
    for piece in town.pieces:
        for curb in piece.curbs:
            poses += _at_curb(generator, curb, share)
        for stall in piece.stalls:
            if generator.uniform() < share:
                shift = generator.uniform(-0.3, 0.3)
                poses.append(ahead(stall, shift, 0.0, generator.normal(0.0, 0.02)))
    ways = [way for piece in town.pieces for way in piece.footways if _is_near(way)]
    lanes = np.concatenate([lane.line[::5] for lane in town.lanes])
    for _ in range(int(generator.integers(2, 46)) if ways else 0):
        poses += _lot(generator, ways, lanes)
    near = [pose for pose in poses if pose.x**2 + pose.y**2 < REACH**2]
    return [
        standing(ObjectType.VEHICLE, _size(generator), pose, num_steps) for pose in near
    ]


def _at_curb(
    generator: np.random.Generator, curb: np.ndarray, share: float
) -> list[Pose]:
    station, yaw = stations(curb), headings(curb)
    poses = []
    at = generator.uniform(0.0, 12.0)
    while at < station[-1]:
        if generator.uniform() < share:
            x, y, heading = (
                float(np.interp(at, station, values)) for values in (*curb.T, yaw)
            )
            turn = generator.normal(0.0, 0.015)
            poses.append(Pose(x, y, heading + turn))
        at += generator.uniform(*CURB_SPACING)
    return poses


def _is_near(way: Line) -> bool:
    x, y = way[len(way) // 2]
    return bool(x * x + y * y < REACH**2)


def _lot(generator: np.random.Generator, ways: list[Line], lanes: Line) -> list[Pose]:
    """Draws a row of cars beside one of the ways, clear of all lanes."""
    way = ways[int(generator.integers(len(ways)))]
    at = int(generator.integers(1, len(way) - 1))
    along = way[at] - way[at - 1]
    yaw = float(np.arctan2(along[1], along[0]))
    sign = float(generator.choice([-1.0, 1.0]))
    distance = generator.uniform(*LOT_DISTANCE)
    num = int(generator.integers(1, 10))
    is_along = bool(generator.uniform() < 0.3)
    spacing = 6.0 if is_along else LOT_WIDTH
    corner = Pose(float(way[at, 0]), float(way[at, 1]), yaw)
    facing = (0.0 if is_along else np.pi / 2) + np.pi * (generator.uniform() < 0.5)
    forward = spacing * np.arange(num)
    at = placed(np.stack([forward, np.full(num, sign * distance)], axis=-1), corner)
    turn = generator.normal(yaw + facing, 0.03, num)
    is_free = generator.uniform(size=num) < 0.8
    gap = at[:, None] - lanes
    is_free &= (gap[..., 0] ** 2 + gap[..., 1] ** 2).min(axis=1) > CLEAR**2
    return [
        Pose(x, y, heading)
        for (x, y), heading, free in zip(
            at.tolist(), turn.tolist(), is_free, strict=True
        )
        if free
    ]


def _size(generator: np.random.Generator) -> Float[np.ndarray, " 3"]:
    low, high = [4.2, 1.85, 1.4], [5.3, 2.25, 1.95]
    return np.round(generator.uniform(low, high), 3)
