"""Joins pieces at their ports to a small town around the origin."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Int

from . import (
    car_park,
    junction,
    lines,
    piece as pieces,
    profile as profiles,
    ramp,
    road,
    roundabout,
)
from .lines import Line, Pose
from .piece import Lane, Piece, Port
from .profile import Profile

REACH = 105.0  # metres from the origin beyond which nothing more is joined
MAX_PIECES = 16
DRAWS = 3  # of a piece before a port stays open
APART = 9.0  # metres between lanes of pieces that do not touch
NEAR_PORT = 26.0  # metres around a port in which the two pieces may be near
JITTER = 0.2  # radians by which the arms of a junction are not square
SHORT, LONG = (20.0, 45.0), (40.0, 100.0)  # metres of roads
THINNED = 5  # of so many points of a lane one is compared

Draw = Callable[[np.random.Generator], Piece]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Town:
    """The pieces of a town, each in its place."""

    kind: str  # of the first piece, which lies at the origin
    pieces: tuple[Piece, ...]
    first_lane: Int[np.ndarray, " pieces"]  # the index of each piece's lane 0
    lanes: tuple[Lane, ...]
    successor: tuple[tuple[int, int], ...]
    neighbor: tuple[tuple[int, int], ...]


def draw(generator: np.random.Generator, kind: str) -> Town:
    """Draws a town.

    A piece whose lanes would come too near to others is drawn again, and left out if
    that does not help.

    Args:
        generator: draws everything.
        kind: of the first piece, one of `KINDS`.
    """
    placed = [pieces.moved(KINDS[kind](generator), Pose(0.0, 0.0, 0.0))]
    joints: list[tuple[tuple[int, ...], tuple[int, ...], int, int]] = []
    waiting = [(0, number) for number in range(len(placed[0].ports))]
    while waiting and len(placed) < MAX_PIECES:
        owner, number = waiting.pop(0)
        port = placed[owner].ports[number]
        is_far = bool(port.pose.x**2 + port.pose.y**2 > REACH**2)
        if is_far and placed[owner].kind == "road":
            continue
        for _ in range(DRAWS):
            new = _next(generator, placed[owner].kind, port, is_far)
            new = pieces.moved(new, _fit(new.ports[0], port))
            if _is_free(new, placed, owner, port):
                joints.append((port.ends, new.ports[0].begins, owner, len(placed)))
                joints.append((new.ports[0].ends, port.begins, len(placed), owner))
                waiting += [(len(placed), k) for k in range(1, len(new.ports))]
                placed.append(new)
                break
    return _town(kind, placed, joints)


def _town(
    kind: str,
    placed: list[Piece],
    joints: list[tuple[tuple[int, ...], tuple[int, ...], int, int]],
) -> Town:
    first = np.cumsum([0, *(len(piece.lanes) for piece in placed)])
    lanes = [lane for piece in placed for lane in piece.lanes]
    successor, neighbor = [], []
    for base, piece in zip(first.tolist(), placed, strict=False):
        successor += [(base + a, base + b) for a, b in piece.successor]
        neighbor += [(base + a, base + b) for a, b in piece.neighbor]
    for ends, begins, before, after in joints:
        for a in ends:
            for b in begins:
                pair = int(first[before]) + a, int(first[after]) + b
                gap = lanes[pair[0]].line[-1] - lanes[pair[1]].line[0]
                if abs(gap[0]) < 0.1 and abs(gap[1]) < 0.1:
                    successor.append(pair)
    return Town(
        kind=kind,
        pieces=tuple(placed),
        first_lane=first[:-1],
        lanes=tuple(welded(lanes, successor)),
        successor=tuple(successor),
        neighbor=tuple(neighbor),
    )


def welded(lanes: list[Lane], successor: list[tuple[int, int]]) -> list[Lane]:
    """Lets lanes that follow each other share their last and first point exactly."""
    ends = [lane.line.copy() for lane in lanes]
    node: dict[tuple[int, int], tuple[int, int]] = {}

    def root(end: tuple[int, int]) -> tuple[int, int]:
        while node.get(end, end) != end:
            end = node[end]
        return end

    for before, after in successor:
        a, b = root((before, -1)), root((after, 0))
        node[max(a, b)] = min(a, b)
    for end in list(node):
        first = root(end)
        ends[end[0]][end[1]] = ends[first[0]][first[1]]
    return [
        dataclasses.replace(lane, line=line)
        for lane, line in zip(lanes, ends, strict=True)
    ]


def _fit(own: Port, onto: Port) -> Pose:
    """Returns where a piece must lie for its port to face another one."""
    yaw = lines.wrap(onto.pose.yaw + np.pi - own.pose.yaw)
    x, y = lines.rotate(np.array([own.pose.x, own.pose.y]), yaw)
    return Pose(float(onto.pose.x - x), float(onto.pose.y - y), yaw)


def _is_free(new: Piece, placed: list[Piece], owner: int, port: Port) -> bool:
    """Tells if the lanes of a piece keep clear of all others but at its port.

    Args:
        new: the piece, in its place.
        placed: those that are there.
        owner: which of them has the port.
        port: which the piece is joined to.
    """
    mine = _thinned(new)
    gap = mine - np.array([port.pose.x, port.pose.y])
    is_away = gap[:, 0] ** 2 + gap[:, 1] ** 2 > NEAR_PORT**2
    low, high = mine.min(axis=0) - APART, mine.max(axis=0) + APART
    for number, piece in enumerate(placed):
        points = mine[is_away] if number == owner else mine
        theirs = _thinned(piece)
        if (theirs.min(axis=0) > high).any() or (theirs.max(axis=0) < low).any():
            continue
        gap = points[:, None] - theirs
        if (gap[..., 0] ** 2 + gap[..., 1] ** 2 < APART**2).any():
            return False
    return True


def _thinned(piece: Piece) -> Line:
    return np.concatenate([lane.line[::THINNED] for lane in piece.lanes])


def _next(generator: np.random.Generator, kind: str, port: Port, is_far: bool) -> Piece:
    """Draws what follows a port: a road after all but roads, a short one far away."""
    entry = port.profile.reversed()  # as seen from inside the new piece, looking out
    if kind != "road":
        return _street(generator, port.profile, SHORT if is_far else LONG)
    if entry.left == 0 or entry.right == 0:
        return _street(generator, port.profile, LONG)
    chance = generator.uniform()
    if entry.is_small and chance < 0.1:
        return car_park.car_park(generator, _plain(port.profile))
    if entry.is_small and chance < 0.2:
        return roundabout.roundabout(generator, entry, _angles(generator, 3))
    if chance < 0.25:
        return _street(generator, port.profile, LONG)
    return _crossroads(generator, entry)


def _street(
    generator: np.random.Generator, begin: Profile, lengths: tuple[float, float]
) -> Piece:
    """Draws a road that begins as it is told, and may gain or lose a lane."""
    end = begin
    if generator.uniform() < 0.15 and not begin.has_bike_lanes:
        change = int(generator.choice([-1, 1]))
        if 1 <= begin.right + change <= 3 and begin.right:
            end = dataclasses.replace(end, right=begin.right + change)
    length = generator.uniform(*lengths)
    piece = road.road(road.curvature(generator, length, 0.6), begin, end)
    return road.with_driveways(generator, piece)


def _long_street(generator: np.random.Generator) -> Piece:
    """Draws the road that a town is about, its middle at the origin."""
    begin = profiles.draw(
        generator, int(generator.choice([1, 2, 3], p=[0.35, 0.3, 0.35]))
    )
    end = begin
    if begin.right > 1 and not begin.has_bike_lanes and generator.uniform() < 0.4:
        end = dataclasses.replace(begin, right=begin.right - 1)
    length = generator.uniform(130.0, 200.0)
    piece = road.road(road.curvature(generator, length, 1.4), begin, end)
    piece = road.with_driveways(generator, piece)
    middle = piece.lanes[0].line[len(piece.lanes[0].line) // 2]
    return pieces.moved(piece, Pose(-float(middle[0]), -float(middle[1]), 0.0))


def _roundabout(generator: np.random.Generator) -> Piece:
    profile = _plain(profiles.draw(generator, 1))
    num_arms = int(generator.choice([3, 4]))
    return roundabout.roundabout(generator, profile, _angles(generator, num_arms))


def _car_park(generator: np.random.Generator) -> Piece:
    """Draws a car park with the origin amid its places."""
    piece = car_park.car_park(generator, _plain(profiles.draw(generator, 1)))
    return pieces.moved(piece, Pose(-12.0, 0.0, 0.0))


def _ramp(generator: np.random.Generator) -> Piece:
    return ramp.ramp(generator)


def _junction(generator: np.random.Generator) -> Piece:
    num_lanes = int(generator.choice([1, 2, 3], p=[0.33, 0.29, 0.38]))
    return _crossroads(generator, profiles.draw(generator, num_lanes))


def _crossroads(generator: np.random.Generator, entry: Profile) -> Piece:
    """Draws a junction whose arm 0 has a given profile, as seen from its middle."""
    num_arms = int(generator.choice([3, 4], p=[0.45, 0.55]))
    angles = _angles(generator, num_arms)
    turned = [lines.wrap(angle - angles[0] - np.pi) for angle in angles]
    number = max(entry.left, entry.right)
    crossing = max(1, number - int(generator.integers(0, 3)))
    if generator.uniform() < 0.15:
        crossing = min(number + 1, 3)
    cross = profiles.draw(generator, crossing)
    goes_on = dataclasses.replace(entry, right=number, left=number, limit=entry.limit)
    of_arms = [entry]
    of_arms += [goes_on if abs(turn) < 0.5 else cross for turn in turned[1:]]
    control = _control(generator, max(p.left for p in of_arms), num_arms)
    return junction.junction(generator, tuple(of_arms), angles, control)


def _control(
    generator: np.random.Generator, num_lanes: int, num_arms: int
) -> junction.Control:
    chance = generator.uniform()
    if chance < (0.08, 0.45, 0.7)[num_lanes - 1]:
        return "lights"
    if num_arms == 4 and num_lanes == 1 and chance < 0.6:
        return "all_way_stop"
    return "stop" if chance < 0.96 else "none"


def _angles(generator: np.random.Generator, num_arms: int) -> tuple[float, ...]:
    """Draws the angles of arms, rising from that of arm 0, which is pi."""
    quarters = [1, 2, 3]
    if num_arms == 3:
        quarters.remove(int(generator.integers(1, 4)))
    jitter = generator.uniform(-JITTER, JITTER, len(quarters))
    jitter *= generator.uniform() < 0.6
    bent = [
        float(np.pi * (1 + quarter / 2) + angle)
        for quarter, angle in zip(quarters, jitter, strict=True)
    ]
    return (np.pi, *bent)


def _plain(profile: Profile) -> Profile:
    """Returns the profile without bicycle lanes and wide shoulders."""
    shoulder = min(profile.shoulder, 1.0)
    return dataclasses.replace(profile, has_bike_lanes=False, shoulder=shoulder)


KINDS: dict[str, Draw] = {
    "junction": _junction,
    "road": _long_street,
    "roundabout": _roundabout,
    "ramp": _ramp,
    "carpark": _car_park,
}
