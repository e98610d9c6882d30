"""Brings logs to steps of 0.1 s, and chooses the step from which they are simulated."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from ..scenario import DT, Lights, Scenario, ScenarioError, Tracks
from . import parts

MAX_STEPS = 10_000  # of a log: a thousand seconds
SAME_RATE = 1e-6  # seconds by which steps may differ from 0.1 s
ON_STEP = 1e-6  # of a step: nearer to a logged one, a new step is that


@dataclasses.dataclass(frozen=True, kw_only=True)
class Timeline:
    """How the steps of a log become those of the simulator."""

    other_rates: Literal["resample", "refuse"] = "resample"  # steps of not 0.1 s
    current_step: int | None = None  # the last of history; None: as the format has it

    def __post_init__(self) -> None:
        """Checks the step.

        Raises:
            ValueError: if it is negative.
        """
        if self.current_step is not None and self.current_step < 0:
            raise ValueError(
                f"current_step must be at least 0, got {self.current_step}."
            )


DEFAULT = Timeline()


def aligned(scenario: Scenario, timeline: Timeline) -> Scenario:
    """Returns the scenario in steps of 0.1 s from its first logged step on.

    Positions follow cubic curves through the logged ones (Catmull and Rom 1974),
    velocities are the derivatives of these, yaw turns the shorter way at a constant
    rate, and a light shows what it showed at the logged step before. A new step is
    valid between two valid ones.

    Raises:
        ScenarioError: if steps are not of 0.1 s and such logs are refused, or there
            would be more than 10,000, or too many states in all.
    """
    if timeline.current_step is not None:
        scenario = dataclasses.replace(scenario, current_step=timeline.current_step)
    if abs(scenario.dt - DT) <= SAME_RATE:
        return dataclasses.replace(scenario, dt=DT)
    if timeline.other_rates == "refuse":
        raise ScenarioError(
            f"the steps take {scenario.dt:g} s; only steps of {DT:g} s are wanted "
            "(--timeline.other-rates resample brings others to them)"
        )
    duration = (scenario.num_steps - 1) * scenario.dt
    num_steps = int(duration / DT + ON_STEP) + 1
    if not 0 < num_steps <= MAX_STEPS:
        raise ScenarioError(
            f"the log takes {duration:g} s, at most {MAX_STEPS * DT:g} s fit"
        )
    # A short log of long steps may have a hundred times as many of 0.1 s.
    for items, most, what in (
        (scenario.tracks.valid, parts.MAX_STATES, "states of objects"),
        (scenario.lights.valid, parts.MAX_LIGHT_STEPS, "states of lights"),
    ):
        parts.require_few(len(items) * num_steps, most, f"{what} in steps of {DT:g} s")
    place = _Place.of(num_steps, scenario)
    current = scenario.current_step
    if timeline.current_step is None:
        current = round(current * scenario.dt / DT)
    return dataclasses.replace(
        scenario,
        dt=DT,
        current_step=current,
        tracks=_tracks(scenario.tracks, place, scenario.dt),
        lights=_lights(scenario.lights, place),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class _Place:
    """Where the new steps lie among the logged ones."""

    before: Int[np.ndarray, " new_steps"]
    after: Int[np.ndarray, " new_steps"]  # the same where a new step is a logged one
    share: Float[np.ndarray, " new_steps"]  # of the way from one to the other

    @classmethod
    def of(cls, num_steps: int, scenario: Scenario) -> "_Place":
        exact = np.arange(num_steps) * (DT / scenario.dt)
        nearest = np.round(exact)
        exact = np.where(np.abs(exact - nearest) < ON_STEP, nearest, exact)
        before = np.floor(exact).astype(np.int64)
        after = np.minimum(np.ceil(exact).astype(np.int64), scenario.num_steps - 1)
        return cls(before, after, exact - before)


def _tracks(tracks: Tracks, place: _Place, dt: float) -> Tracks:
    valid = tracks.valid[:, place.before] & tracks.valid[:, place.after]
    slope = _slopes(tracks.xyz, tracks.valid)
    start, end = tracks.xyz[:, place.before], tracks.xyz[:, place.after]
    xyz, per_step = _curve(
        start, end, slope[:, place.before], slope[:, place.after], place.share[:, None]
    )
    first_yaw, last_yaw = tracks.yaw[:, place.before], tracks.yaw[:, place.after]
    turn = parts.wrap_angle(last_yaw - first_yaw)
    yaw = parts.wrap_angle(first_yaw + place.share * turn)
    is_logged = place.share == 0
    velocity = np.where(
        is_logged[:, None], tracks.velocity[:, place.before], per_step[..., :2] / dt
    )
    return dataclasses.replace(
        tracks,
        xyz=np.where(valid[..., None], xyz, 0.0),
        yaw=np.where(valid, yaw, 0.0),
        velocity=np.where(valid[..., None], velocity, 0.0),
        valid=valid,
    )


def _slopes(
    xyz: Float[np.ndarray, "objects steps 3"], valid: Bool[np.ndarray, "objects steps"]
) -> Float[np.ndarray, "objects steps 3"]:
    """Returns the change of position per step, the mean of those to valid steps."""
    change = np.diff(xyz, axis=1)
    known = (valid[:, 1:] & valid[:, :-1])[..., None]
    change = np.where(known, change, 0.0)
    total, count = np.zeros_like(xyz), np.zeros((*valid.shape, 1))
    for side in (slice(None, -1), slice(1, None)):
        total[:, side] += change
        count[:, side] += known
    return total / np.maximum(count, 1)


def _curve(start, end, start_slope, end_slope, share):
    """Returns the cubic Hermite curve and its derivative, per step."""
    s, rest = share, 1 - share
    xyz = (
        (1 + 2 * s) * rest**2 * start
        + s * rest**2 * start_slope
        + s**2 * (3 - 2 * s) * end
        - s**2 * rest * end_slope
    )
    slope = (
        6 * s * rest * (end - start)
        + rest * (1 - 3 * s) * start_slope
        + s * (3 * s - 2) * end_slope
    )
    return xyz, slope


def _lights(lights: Lights, place: _Place) -> Lights:
    return dataclasses.replace(
        lights,
        state=lights.state[:, place.before],
        valid=lights.valid[:, place.before],
    )
