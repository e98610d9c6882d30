"""Draws junctions of three or four roads, with lights, with stop signs or without.

The middle is the origin; arm 0 leaves along -x, so that a driver comes in along +x.
"""

import dataclasses
import itertools
from typing import Literal

import numpy as np

from ...scenario import MapType
from . import lines
from .lines import Line, Pose
from .piece import Crossing, Lane, Piece, Port, Shape, Signals, Turn
from .profile import Profile
from .road import FOOTWAY

Control = Literal["lights", "all_way_stop", "stop", "none"]

BAND = 5.0  # metres between a stop line and the corner, where pedestrians cross
CROSSWALK = (1.2, 4.2)  # metres from the stop line to a crosswalk's sides
STRAIGHT_ON = 0.6  # radians: who turns less goes ahead
TURN_SPEED = 9.0  # metres per second: the limit of lanes that turn
RANKS: dict[tuple[bool, Turn], int] = {
    (True, "ahead"): 5,
    (True, "right"): 4,
    (True, "left"): 3,
    (False, "right"): 2,
    (False, "ahead"): 1,
    (False, "left"): 0,
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Arm:
    """One road of a junction, seen from the middle."""

    angle: float  # radians
    profile: Profile
    line: float  # metres from the middle to the stop line

    @property
    def pose(self) -> Pose:
        """The place of the stop line, looking out."""
        return lines.ahead(Pose(0.0, 0.0, self.angle), self.line)

    def lane_in(self, lane: int) -> Pose:
        """Returns where a lane comes in, looking in."""
        side = self.profile.lane_offset(lane)
        return lines.turned_round(lines.ahead(self.pose, 0.0, side))

    def lane_out(self, lane: int) -> Pose:
        """Returns where a lane leads out, looking out."""
        return lines.ahead(self.pose, 0.0, -self.profile.lane_offset(lane))


@dataclasses.dataclass(frozen=True)
class _Movement:
    """A lane across the junction."""

    arm: int
    lane: int
    to_arm: int
    to_lane: int
    turn: Turn


def junction(
    generator: np.random.Generator,
    profiles: tuple[Profile, ...],
    angles: tuple[float, ...],
    control: Control,
) -> Piece:
    """Returns a junction of roads.

    Args:
        generator: draws corners, phases and crosswalks.
        profiles: of each arm, as seen from the middle.
        angles: of the arms, rising from that of arm 0 [rad].
        control: what says who goes first; with `stop` and `none` the straighter or
            wider road has priority.
    """
    arms = _arms(profiles, angles, generator.uniform(4.5, 9.0))
    movements = _movements(generator, arms, control)
    has_crosswalks = generator.uniform() < (0.9 if control == "lights" else 0.35)
    axes = _axes(arms)
    signals = _signals(generator, axes) if control == "lights" else None
    main = axes[0] if control in ("stop", "none") else tuple(range(len(arms)))
    lanes = tuple(_lane(arms, move, control, main) for move in movements)
    if signals is not None:
        lanes = tuple(_protected(lane, signals) for lane in lanes)
    return Piece(
        kind="junction",
        ports=tuple(_port(arms, movements, k) for k in range(len(arms))),
        lanes=lanes,
        shapes=(
            *_corners(arms),
            *(_nose(arm) for arm in arms if arm.profile.median > 0),
            *(_crosswalk(arm) for arm in arms if has_crosswalks),
        ),
        signs=_signs(arms, movements, control, main),
        signals=signals,
        crossings=tuple(
            _crossing(arm, 2 * k if signals else None)
            for k, arm in enumerate(arms)
            if has_crosswalks
        ),
    )


def _arms(
    profiles: tuple[Profile, ...], angles: tuple[float, ...], corner: float
) -> list[_Arm]:
    """Returns arms that are long enough for corners of `corner` metres."""
    num = len(angles)
    reach = np.zeros(num)
    for k in range(num):
        after = (k + 1) % num
        apart = (angles[after] - angles[k]) % (2 * np.pi)
        mine = profiles[k].half_width(profiles[k].left)
        other = profiles[after].half_width(profiles[after].right)
        if apart < 0.8 * np.pi:
            s, c = np.sin(apart), np.cos(apart)
            reach[k] = max(reach[k], (other + mine * c) / s)
            reach[after] = max(reach[after], (mine + other * c) / s)
        else:
            reach[k], reach[after] = max(reach[k], mine), max(reach[after], other)
    return [
        _Arm(angle=angle, profile=profile, line=float(far) + corner + BAND)
        for angle, profile, far in zip(angles, profiles, reach, strict=True)
    ]


def _turn(arms: list[_Arm], arm: int, to_arm: int) -> Turn:
    angle = lines.wrap(arms[to_arm].angle - arms[arm].angle - np.pi)
    if abs(angle) < STRAIGHT_ON:
        return "ahead"
    return "left" if angle > 0 else "right"


def _movements(
    generator: np.random.Generator, arms: list[_Arm], control: Control
) -> list[_Movement]:
    """Returns which lane leads where: left from the inner, right from the outer one."""
    found = []
    for k, arm in enumerate(arms):
        num = arm.profile.left
        turns: dict[Turn, int] = {
            _turn(arms, k, j): j for j in range(len(arms)) if j != k
        }
        turns = {turn: j for turn, j in turns.items() if arms[j].profile.right}
        left_only = num >= 2 and "left" in turns and "ahead" in turns
        left_only &= num >= 3 or (control == "lights" and generator.uniform() < 0.6)
        right_only = "ahead" in turns and "right" in turns
        right_only &= num >= 3 and generator.uniform() < 0.3
        for turn, j in turns.items():
            num_out = arms[j].profile.right
            if turn == "ahead":
                kept = range(int(left_only), num - int(right_only))
                to = [min(max(i, 0), num_out - 1) for i in kept]
                pairs = [(i, t) for i, t in zip(kept, to, strict=True)]
                pairs = [p for n, p in enumerate(pairs) if to.index(p[1]) == n]
            elif turn == "left":
                pairs = [(0, 0)]
                if left_only and num >= 4 and num_out >= 2:
                    pairs.append((1, 1))
            else:
                pairs = [(num - 1, num_out - 1)]
            found += [_Movement(k, i, j, t, turn) for i, t in pairs if i >= 0]
    return _complete(found, arms)


def _complete(found: list[_Movement], arms: list[_Arm]) -> list[_Movement]:
    """Gives lanes that lead nowhere, or that nothing leads to, a movement ahead."""
    used = {(m.arm, m.lane) for m in found}
    for m in [m for m in found if m.turn == "ahead"]:
        for lane in range(arms[m.arm].profile.left):
            if (m.arm, lane) not in used:
                used.add((m.arm, lane))
                to_lane = min(lane, arms[m.to_arm].profile.right - 1)
                found.append(_Movement(m.arm, lane, m.to_arm, to_lane, "ahead"))
    for k, arm in enumerate(arms):
        for lane in range(arm.profile.left):
            if (k, lane) not in used:
                near = min(
                    (m for m in found if m.arm == k), key=lambda m: abs(m.lane - lane)
                )
                out = arms[near.to_arm].profile.right - 1
                found.append(
                    dataclasses.replace(near, lane=lane, to_lane=min(lane, out))
                )
    return found


def _lane(
    arms: list[_Arm], move: _Movement, control: Control, main: tuple[int, ...]
) -> Lane:
    begin = arms[move.arm].lane_in(move.lane)
    end = arms[move.to_arm].lane_out(move.to_lane)
    limit = arms[move.arm].profile.limit
    is_main = move.arm in main
    is_left = int(move.turn == "left")
    return Lane(
        line=lines.join(begin, end),
        width=arms[move.arm].profile.lane_width,
        limit=limit if move.turn == "ahead" else min(limit, TURN_SPEED),
        turn=move.turn,
        rank=0 if control == "all_way_stop" else RANKS[is_main, move.turn],
        group=2 * move.arm + is_left if control == "lights" else None,
        stops=_stops(control, is_main),
    )


def _protected(lane: Lane, signals: Signals) -> Lane:
    """Returns the lane; nobody has to be let by where a phase of its own protects."""
    if lane.group not in signals.protected:
        return lane
    return dataclasses.replace(lane, rank=RANKS[True, "ahead"])


def _stops(control: Control, is_main: bool) -> bool:
    return control == "all_way_stop" or (control == "stop" and not is_main)


def _axes(arms: list[_Arm]) -> list[tuple[int, ...]]:
    """Returns the arms by roads that go on across the middle, the main road first."""
    if len(arms) == 4:
        pairs = [(0, 2), (1, 3)]
        return sorted(pairs, key=lambda pair: -arms[pair[0]].profile.left)

    def bent(pair: tuple[int, ...]) -> float:
        first, second = pair
        return abs(lines.wrap(arms[first].angle - arms[second].angle - np.pi))

    pair = min([(0, 1), (0, 2), (1, 2)], key=bent)
    return [pair, (3 - sum(pair),)]


def _port(arms: list[_Arm], movements: list[_Movement], arm: int) -> Port:
    """Returns a port; its lanes across begin and end there, several from each lane."""
    return Port(
        pose=arms[arm].pose,
        profile=arms[arm].profile,
        begins=tuple(i for i, m in enumerate(movements) if m.arm == arm),
        ends=tuple(i for i, m in enumerate(movements) if m.to_arm == arm),
    )


def _signals(generator: np.random.Generator, pairs: list[tuple[int, ...]]) -> Signals:
    """Draws phases: left turns apart, left turns that give way, or arm by arm.

    The groups of arm k are 2 k, ahead and right, and 2 k + 1, left.
    """
    case = generator.choice(["protected", "permissive", "split"], p=[0.55, 0.25, 0.2])
    phases: list[frozenset[int]] = []
    for pair in pairs:
        ahead = frozenset(2 * k for k in pair)
        left = frozenset(2 * k + 1 for k in pair)
        if len(pair) == 1 or case == "permissive":
            phases.append(ahead | left)
        elif case == "protected":
            phases += [left, ahead]
        else:
            phases += [frozenset((2 * k, 2 * k + 1)) for k in pair]
    groups = itertools.chain.from_iterable(phases)
    protected = {group for group in groups if group % 2 and case != "permissive"} | {
        2 * k + 1 for pair in pairs if len(pair) == 1 for k in pair
    }
    return Signals(
        phases=tuple(phases),
        protected=frozenset(protected),
        num_groups=2 * sum(len(pair) for pair in pairs),
    )


def _corners(arms: list[_Arm]) -> list[Shape]:
    """Returns the edges from each arm to the next, with the road on their left."""
    shapes = []
    for k, arm in enumerate(arms):
        after = arms[(k + 1) % len(arms)]
        mine = arm.profile.half_width(arm.profile.left)
        other = after.profile.half_width(after.profile.right)
        begin = lines.turned_round(lines.ahead(arm.pose, 0.0, mine))
        end = lines.ahead(after.pose, 0.0, -other)
        shapes.append((MapType.EDGE_BOUNDARY, lines.join(begin, end)))
    return shapes


def _nose(arm: _Arm) -> Shape:
    """Returns the end of a median, from its left edge to its right one."""
    half = arm.profile.median / 2
    angle = np.linspace(-np.pi / 2, -3 * np.pi / 2, 9)
    xy = half * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return MapType.EDGE_MEDIAN, lines.placed(xy, arm.pose)


def _crosswalk(arm: _Arm) -> Shape:
    near, far = (-side for side in CROSSWALK)
    right = -arm.profile.half_width(arm.profile.right)
    left = arm.profile.half_width(arm.profile.left)
    box = [[near, right], [far, right], [far, left], [near, left], [near, right]]
    return MapType.CROSSWALK, lines.placed(np.array(box), arm.pose)


def _crossing(arm: _Arm, group: int | None) -> Crossing:
    """Returns a footway across an arm, from its right to its left."""
    right = arm.profile.half_width(arm.profile.right) + FOOTWAY
    left = arm.profile.half_width(arm.profile.left) + FOOTWAY
    y = np.linspace(-right, left, round((left + right) / lines.STEP) + 1)
    x = np.full_like(y, -sum(CROSSWALK) / 2)
    line: Line = lines.placed(np.stack([x, y], axis=-1), arm.pose)
    return Crossing(line=line, group=group)


def _signs(
    arms: list[_Arm],
    movements: list[_Movement],
    control: Control,
    main: tuple[int, ...],
) -> tuple[tuple[Pose, tuple[int, ...]], ...]:
    """Returns stop signs beside the lines where one stops, with the lanes across."""
    signs = []
    for k, arm in enumerate(arms):
        if _stops(control, k in main) and arm.profile.left:
            side = arm.profile.half_width(arm.profile.left) + 0.8
            lanes = tuple(i for i, m in enumerate(movements) if m.arm == k)
            signs.append((lines.ahead(arm.pose, 0.0, side), lanes))
    return tuple(signs)
