"""Lets the lights of a junction run through their phases."""

import numpy as np
from jaxtyping import Bool, Int

from ...scenario import DT, LightState
from .piece import Signals

LEFT_GREEN = (5.0, 10.0)  # seconds of a phase that lets traffic turn left alone
GREEN = (8.0, 24.0)  # seconds of any other
YELLOW, ALL_RED = (3.0, 4.0), (1.0, 2.0)  # seconds


def states(
    generator: np.random.Generator, signals: Signals, num_steps: int
) -> Int[np.ndarray, "groups steps"]:
    """Returns what each group of lanes is shown, from some moment of the cycle on.

    One phase follows the other, with yellow and a time of red for all in between.
    """
    yellow = generator.uniform(*YELLOW)
    all_red = generator.uniform(*ALL_RED)
    greens = [
        generator.uniform(*(LEFT_GREEN if all(g % 2 for g in phase) else GREEN))
        for phase in signals.phases
    ]
    lengths = np.array([green + yellow + all_red for green in greens])
    ends = np.cumsum(lengths)
    time = generator.uniform(0.0, ends[-1]) + DT * np.arange(num_steps)
    time = time % ends[-1]
    phase = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
    since = time - (ends - lengths)[phase]
    green = np.array(greens)[phase]
    result = np.full((signals.num_groups, num_steps), int(LightState.STOP))
    for number, groups in enumerate(signals.phases):
        for group in groups:
            goes = (phase == number) & (since < green)
            warns = (phase == number) & ~goes & (since < green + yellow)
            result[group] = np.select(
                [goes, warns], [LightState.GO, LightState.CAUTION], LightState.STOP
            )
    arrows = [g for g in sorted(signals.protected) if _is_apart(signals, g)]
    result[arrows] -= LightState.STOP - LightState.ARROW_STOP
    return result


def _is_apart(signals: Signals, group: int) -> bool:
    """Tells if a group has green in phases of left turns alone, as arrows show."""
    return all(
        other % 2 for phase in signals.phases if group in phase for other in phase
    )


def goes(state: Int[np.ndarray, "*any"]) -> Bool[np.ndarray, "*any"]:
    """Tells where a light shows green."""
    return (state == LightState.GO) | (state == LightState.ARROW_GO)


def warns(state: Int[np.ndarray, "*any"]) -> Bool[np.ndarray, "*any"]:
    """Tells where a light shows yellow."""
    return (state == LightState.CAUTION) | (state == LightState.ARROW_CAUTION)
