"""Draws roundabouts of three or four small roads.

The middle is the origin; arm 0 leaves along -x. Traffic goes round anticlockwise, and
who comes in gives way.
"""

import dataclasses

import numpy as np

from ...scenario import MapType
from . import lines
from .lines import Line, Pose
from .piece import Lane, Piece, Port, Shape
from .profile import Profile

RING_WIDTH = 4.6  # metres
RING_SPEED = 8.0  # metres per second
APPROACH = 18.0  # metres from the ring to the ports
ENTRY = 0.5  # radians from an arm to where its lanes meet the ring
EDGE_ENTRY = 0.62  # radians from an arm to where its edges meet the outer circle


@dataclasses.dataclass(frozen=True)
class _Ring:
    """What all lanes of a roundabout share."""

    radius: float  # metres, of the lane
    angles: tuple[float, ...]  # of the arms [rad]
    profile: Profile

    def pose(self, angle: float, radius: float) -> Pose:
        """Returns a place on a circle about the middle, looking anticlockwise."""
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        return Pose(float(x), float(y), angle + np.pi / 2)

    def port(self, arm: int) -> Pose:
        """Returns the place of a port, looking out."""
        return lines.ahead(Pose(0.0, 0.0, self.angles[arm]), self.radius + APPROACH)

    def along(self, begin: float, end: float, radius: float) -> Line:
        """Returns an arc of a circle about the middle, from one angle to another."""
        num_cells = max(round(abs(end - begin) * radius / lines.STEP), 2)
        angle = np.linspace(begin, end, num_cells + 1)
        return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def roundabout(
    generator: np.random.Generator, profile: Profile, angles: tuple[float, ...]
) -> Piece:
    """Returns a roundabout.

    Args:
        generator: draws its size.
        profile: of all arms, with one lane in each direction and no median.
        angles: of the arms, rising from that of arm 0 [rad].
    """
    ring = _Ring(generator.uniform(14.0, 19.0), angles, profile)
    num = len(angles)
    lanes, successor = [], []
    for k in range(num):  # lanes 4 k to 4 k + 3: in, past the arm, on to the next, out
        after = (k + 1) % num
        lanes += _lanes_of(ring, k)
        entry, past, on = 4 * k, 4 * k + 1, 4 * k + 2
        successor += [(entry, on), (past, on)]
        successor += [(on, 4 * after + 3), (on, 4 * after + 1)]
    island = ring.along(0.0, -2 * np.pi, ring.radius - RING_WIDTH / 2)
    island[-1] = island[0]
    return Piece(
        kind="roundabout",
        ports=tuple(
            Port(
                pose=ring.port(k),
                profile=profile,
                begins=(4 * k,),
                ends=(4 * k + 3,),
            )
            for k in range(num)
        ),
        lanes=tuple(lanes),
        successor=tuple(successor),
        shapes=(
            (MapType.EDGE_BOUNDARY, island),
            *(_edge(ring, k) for k in range(num)),
        ),
    )


def _lanes_of(ring: _Ring, arm: int) -> list[Lane]:
    angle, side = ring.angles[arm], ring.profile.lane_offset(0)
    after = ring.angles[(arm + 1) % len(ring.angles)]
    after += 2 * np.pi * (after < angle)
    port = ring.port(arm)
    begin = lines.turned_round(lines.ahead(port, 0.0, side))
    entry, leave = angle + ENTRY, angle - ENTRY
    lines_of = [
        lines.join(begin, ring.pose(entry, ring.radius)),
        ring.along(leave, entry, ring.radius),
        ring.along(entry, after - ENTRY, ring.radius),
        lines.join(ring.pose(leave, ring.radius), lines.ahead(port, 0.0, -side)),
    ]
    width = (ring.profile.lane_width, RING_WIDTH, RING_WIDTH, ring.profile.lane_width)
    limit = min(ring.profile.limit, RING_SPEED)
    return [
        Lane(line=line, width=w, limit=limit, rank=int(i > 0))
        for i, (line, w) in enumerate(zip(lines_of, width, strict=True))
    ]


def _edge(ring: _Ring, arm: int) -> Shape:
    """Returns the edge from an arm to the next, with the road on its left."""
    num = len(ring.angles)
    angle, after = ring.angles[arm], ring.angles[(arm + 1) % num]
    after += 2 * np.pi * (after < angle)
    outer = ring.radius + RING_WIDTH / 2 + 0.4
    half = ring.profile.half_width(1)
    begin = lines.turned_round(lines.ahead(ring.port(arm), 0.0, half))
    end = lines.ahead(ring.port((arm + 1) % num), 0.0, -half)
    first, last = angle + EDGE_ENTRY, after - EDGE_ENTRY
    pieces = [
        lines.join(begin, ring.pose(first, outer)),
        ring.along(first, last, outer)[1:-1],
        lines.join(ring.pose(last, outer), end),
    ]
    return MapType.EDGE_BOUNDARY, np.concatenate(pieces)
