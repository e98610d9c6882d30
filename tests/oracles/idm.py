"""Oracle of the IDM sim agents: `definitions.md` section 6, Treiber et al. 2000.

One scenario, plain loops, float64.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from . import geometry
from .geometry import Box, boxes_overlap

VEHICLE = 1  # the object type that drives
MIN_REACH = 1.0  # metres; objects that never get farther away are left to the log
MIN_GAP = 0.1  # metres; keeps the interaction finite at contact


@dataclasses.dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of the IDM, in the symbols of its paper."""

    v0: float = 30.0  # desired speed [m/s]
    s0: float = 2.0  # gap at a standstill [m]
    T: float = 2.0  # time headway [s]
    a: float = 2.0  # acceleration [m/s^2]
    b: float = 4.0  # comfortable braking [m/s^2]
    delta: float = 4.0  # exponent of the free road
    lookahead: float = 50.0  # metres of path ahead that are searched for a leader
    num_chords: int = 10  # straight pieces into which the lookahead is cut
    light_distance: float = 2.0  # metres between the path and a stop point
    light_turn: float = math.pi / 4  # between the path and the lane of a light
    light_braking: float = 6.0  # at most needed for a light that is heeded [m/s^2]
    dt: float = 0.1  # seconds


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """The logged motion of every object. Where not valid, values mean nothing."""

    xyz: Float[np.ndarray, "objects steps 3"]  # metres
    yaw: Float[np.ndarray, "objects steps"]  # radians
    velocity: Float[np.ndarray, "objects steps 2"]  # metres per second
    valid: Bool[np.ndarray, "objects steps"]
    size: Float[np.ndarray, "objects 3"]  # length, width, height [m]
    object_type: Int[np.ndarray, " objects"]


class World(NamedTuple):
    """Where every object is now, whoever drives it."""

    xy: Float[np.ndarray, "objects 2"]  # metres
    yaw: Float[np.ndarray, " objects"]  # radians
    velocity: Float[np.ndarray, "objects 2"]  # metres per second
    valid: Bool[np.ndarray, " objects"]


class Light(NamedTuple):
    """A traffic light of a lane."""

    xy: Float[np.ndarray, " 2"]  # the stop point [m]
    yaw: float  # of the lane there [rad]
    is_red: bool


class Targets(NamedTuple):
    """Where the driven objects go next; 0 for objects left to the log."""

    xy: Float[np.ndarray, "objects 2"]  # metres
    yaw: Float[np.ndarray, " objects"]  # radians
    velocity: Float[np.ndarray, "objects 2"]  # metres per second


class Leader(NamedTuple):
    """What an object follows."""

    gap: float  # metres between its front and the leader
    speed: float  # of the leader along the path [m/s]


def acceleration(speed: float, leader: Leader | None, params: Params) -> float:
    """Returns the acceleration of the IDM [m/s^2].

        a [1 - (v / v0)^delta - (s* / gap)^2]
        s* = s0 + max(0, v T + v (v - v_l) / (2 sqrt(a b)))

    The last term is absent without a leader.
    """
    term = 0.0
    if leader is not None:
        braking = speed * (speed - leader.speed) / (2 * math.sqrt(params.a * params.b))
        desired_gap = params.s0 + max(0.0, speed * params.T + braking)
        term = (desired_gap / leader.gap) ** 2
    return params.a * (1 - (speed / params.v0) ** params.delta - term)


class Path:
    """The way that one object took in the log, from the current step on."""

    def __init__(
        self, xy: Float[np.ndarray, "points 2"], yaw: Float[np.ndarray, " points"]
    ):
        """Measures the arc length at each logged pose."""
        steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
        self.xy = xy
        self.yaw = yaw
        self.arc = np.concatenate([[0.0], np.cumsum(steps)])
        self.ends_backwards = False  # no pose is asked for beyond the end before
        before, _ = self.pose(max(self.arc[-1] - 1.0, 0.0))
        last_metre = xy[-1] - before
        self.ends_backwards = bool(last_metre @ geometry.heading(yaw[-1]) < 0)

    def pose(self, s: float) -> tuple[Float[np.ndarray, " 2"], float]:
        """Returns position [m] and yaw [rad] at the arc length s >= 0.

        Linear between the logged poses, and straight on after them: along the last yaw,
        or against it where the last metre was driven backwards.
        """
        if s >= self.arc[-1]:
            ahead = (s - self.arc[-1]) * geometry.heading(self.yaw[-1])
            ahead = -ahead if self.ends_backwards else ahead
            return self.xy[-1] + ahead, geometry.wrap_angle(self.yaw[-1])
        # The last pose at this arc: the object may have stood for several steps.
        k = int(np.flatnonzero(self.arc <= s)[-1])
        fraction = (s - self.arc[k]) / (self.arc[k + 1] - self.arc[k])
        turn = geometry.wrap_angle(self.yaw[k + 1] - self.yaw[k])
        xy = self.xy[k] + fraction * (self.xy[k + 1] - self.xy[k])
        return xy, geometry.wrap_angle(self.yaw[k] + fraction * turn)


class IdmOracle:
    """Drives the vehicles of one scenario along their logged paths.

    Attributes:
        driven: which objects it drives; the others follow the log.
        arc: how far along its path each driven object is [m].
        speed: of each driven object [m/s].
    """

    def __init__(self, log: Log, current_step: int, params: Params):
        """Starts every driven object at its logged place and speed.

        It drives the vehicles valid at the current step that get at least 1 m away from
        there at some later valid step, and whose box overlaps no other valid one at the
        current step.
        """
        self.params = params
        self.size = log.size
        self.paths: dict[int, Path] = {}
        self.arc: dict[int, float] = {}
        self.speed: dict[int, float] = {}

        now = World(
            log.xyz[:, current_step, :2],
            log.yaw[:, current_step],
            log.velocity[:, current_step],
            log.valid[:, current_step],
        )
        self.driven = np.zeros(len(log.object_type), bool)
        for i in np.flatnonzero((log.object_type == VEHICLE) & now.valid).tolist():
            steps = current_step + np.flatnonzero(log.valid[i, current_step:])
            path = Path(log.xyz[i, steps, :2], log.yaw[i, steps])
            is_free = not any(
                boxes_overlap(self._box(i, now), self._box(j, now))
                for j in self._others(i, now)
            )
            # Not the length of the path: noise makes metres of it for parked cars.
            reach = np.linalg.norm(path.xy - path.xy[0], axis=1).max()
            if reach >= MIN_REACH and is_free:
                self.driven[i] = True
                self.paths[i] = path
                self.arc[i] = 0.0
                self.speed[i] = float(np.linalg.norm(now.velocity[i]))

    def leader(self, i: int, world: World) -> Leader | None:
        """Finds what the driven object i follows: the box that it would meet first.

        The lookahead is cut into chords of its path, rectangles of its own width. Of
        the boxes that overlap a chord the one with the least contact leads; at a tie
        the nearer chord, then the first object.
        """
        spacing = self.params.lookahead / self.params.num_chords
        least, leader = math.inf, None
        for m in range(self.params.num_chords):
            start, _ = self.paths[i].pose(self.arc[i] + m * spacing)
            end, _ = self.paths[i].pose(self.arc[i] + (m + 1) * spacing)
            length = float(np.linalg.norm(end - start))
            if length == 0:  # a path that comes back has no direction here
                continue
            along = (end - start) / length
            yaw = math.atan2(along[1], along[0])
            chord = Box((start + end) / 2, yaw, length, self.size[i, 1])
            for j in self._others(i, world):
                box = self._box(j, world)
                if not boxes_overlap(chord, box):
                    continue
                ahead = float(((geometry.corners(box) - start) @ along).min())
                contact = m * spacing + max(0.0, ahead)
                if contact < least:
                    least = contact
                    gap = max(contact - self.size[i, 0] / 2, MIN_GAP)
                    leader = Leader(gap, float(world.velocity[j] @ along))
        return leader

    def red_light(self, i: int, lights: Sequence[Light]) -> Leader | None:
        """Finds the first red light that concerns the driven object i.

        Of the chords that lead along the lane of a light the one nearest to its stop
        point counts, if near enough; the light is passed if the front is beyond the
        foot of the stop point, or if stopping there takes too much.
        """
        spacing = self.params.lookahead / self.params.num_chords
        gaps = []
        for light in lights:
            feet = []
            for m in range(self.params.num_chords):
                start, _ = self.paths[i].pose(self.arc[i] + m * spacing)
                end, _ = self.paths[i].pose(self.arc[i] + (m + 1) * spacing)
                way = end - start
                turn = geometry.wrap_angle(math.atan2(way[1], way[0]) - light.yaw)
                if not way.any() or abs(turn) >= self.params.light_turn:
                    continue
                share = float(np.clip((light.xy - start) @ way / (way @ way), 0, 1))
                aside = float(np.linalg.norm(light.xy - start - share * way))
                feet.append((aside, (m + share) * spacing))
            if not light.is_red or not feet:
                continue
            aside, foot = min(feet)
            gap = foot - self.size[i, 0] / 2
            if aside > self.params.light_distance or gap <= 0:
                continue
            if self.speed[i] ** 2 / (2 * gap) <= self.params.light_braking:
                gaps.append(gap)
        return Leader(max(min(gaps), MIN_GAP), 0.0) if gaps else None

    def step(self, world: World, lights: Sequence[Light] = ()) -> Targets:
        """Drives on by one step, all objects at once.

            v' = max(0, v + a dt), s' = s + (v + v') dt / 2

        Args:
            world: where every object is before the step, the ego's simulated box too.
            lights: those at which to stop while they are red.
        """
        leaders = {
            i: (self.leader(i, world), self.red_light(i, lights)) for i in self.paths
        }
        num_objects = len(world.valid)
        targets = Targets(
            np.zeros((num_objects, 2)),
            np.zeros(num_objects),
            np.zeros((num_objects, 2)),
        )
        for i, path in self.paths.items():
            v = self.speed[i]
            a = min(acceleration(v, leader, self.params) for leader in leaders[i])
            before, _ = path.pose(self.arc[i])
            self.speed[i] = max(0.0, v + a * self.params.dt)
            self.arc[i] += (v + self.speed[i]) / 2 * self.params.dt

            targets.xy[i], targets.yaw[i] = path.pose(self.arc[i])
            heading = geometry.heading(targets.yaw[i])
            goes_back = (targets.xy[i] - before) @ heading < 0
            targets.velocity[i] = self.speed[i] * (-heading if goes_back else heading)
        return targets

    def _box(self, i: int, world: World) -> Box:
        return Box(world.xy[i], world.yaw[i], self.size[i, 0], self.size[i, 1])

    def _others(self, i: int, world: World) -> list[int]:
        return [j for j in np.flatnonzero(world.valid).tolist() if j != i]
