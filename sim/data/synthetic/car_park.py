"""Draws car parks: an aisle between two rows of places, reached from one end."""

import itertools

import numpy as np

from ...scenario import MapType
from . import lines
from .lines import Line, Pose
from .piece import Lane, Piece, Port
from .profile import Profile

DEPTH = 5.6  # metres of a place, across the aisle
WIDTH = 2.75  # metres of a place, along the aisle
MOUTH = 7.0  # metres from the port to the first place
AISLE_SPEED = 5.5  # metres per second
CLEARANCE = 0.4  # metres between the aisle and the places


def car_park(generator: np.random.Generator, profile: Profile) -> Piece:
    """Returns a car park; its port lies at the origin and looks along -x.

    Args:
        generator: draws its length, and which places there are.
        profile: of the aisle, with one lane in each direction and no median.
    """
    num_places = int(generator.integers(8, 22))
    length = MOUTH + num_places * WIDTH + 3.0
    half = profile.lane_width + CLEARANCE
    sides = [s for s in (1.0, -1.0) if generator.uniform() < 0.85] or [1.0]
    stalls = [
        Pose(
            MOUTH + (i + 0.5) * WIDTH,
            side * (half + DEPTH / 2),
            side * np.pi / 2 + np.pi * (generator.uniform() < 0.3),
        )
        for side in sides
        for i in range(num_places)
    ]
    into = lines.straight(Pose(0.0, -profile.lane_offset(0), 0.0), length - 3.0)
    out = lines.straight(
        Pose(length - 3.0, profile.lane_offset(0), np.pi), length - 3.0
    )
    mouth = profile.half_width(1)
    bump = [[2.0, -mouth], [3.0, -mouth], [3.0, mouth], [2.0, mouth], [2.0, -mouth]]
    limit = min(profile.limit, AISLE_SPEED)
    lanes = tuple(
        Lane(line=line, width=profile.lane_width, limit=limit) for line in (into, out)
    )
    port = Port(
        pose=Pose(0.0, 0.0, np.pi), profile=profile.reversed(), begins=(0,), ends=(1,)
    )
    return Piece(
        kind="carpark",
        ports=(port,),
        lanes=lanes,
        shapes=(
            (MapType.EDGE_BOUNDARY, _edge(profile, half, length, sides)),
            (MapType.SPEED_BUMP, np.array(bump)),
        ),
        stalls=tuple(stalls),
    )


def _edge(profile: Profile, half: float, length: float, sides: list[float]) -> Line:
    """Returns the edge along the right side, round the end and back."""
    mouth = profile.half_width(1)

    def side(sign: float) -> list[list[float]]:
        depth = half + (DEPTH if sign in sides else 0.0)
        return [
            [0.0, sign * mouth],
            [MOUTH - 1.5, sign * mouth],
            [MOUTH - 0.5, sign * depth],
            [length, sign * depth],
        ]

    corners = np.array(side(-1.0) + side(1.0)[::-1])
    points = [
        lines.resample(np.stack([a, b]))[:-1] for a, b in itertools.pairwise(corners)
    ]
    return np.concatenate([*points, corners[-1:]])
