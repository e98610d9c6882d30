"""Lets pedestrians walk beside roads and over crosswalks."""

import numpy as np
from jaxtyping import Bool, Float

from ...scenario import DT
from . import signals
from .courses import Rules
from .lines import Line, stations
from .mover import Mover, walking

SPEED = (0.8, 1.7)  # metres per second
NEAR = 3.2  # metres from a pedestrian to the middle of a lane that is kept free
BEFORE = 18  # steps for which a lane is kept free before a pedestrian comes near
DRAWS = 6  # of a moment at which the lights let one cross
MARGIN = 1.0  # metres beyond the edges at which one must not meet green
SIGHT = 75.0  # metres from the origin


def walkers(
    generator: np.random.Generator, rules: Rules, num_steps: int
) -> tuple[list[Mover], list[Mover]]:
    """Draws pedestrians on footways, and those who cross.

    Who crosses at lights does so while those of the arm are red.
    """
    amount = float(generator.choice([0.0, 3.0, 8.0, 24.0], p=[0.25, 0.35, 0.25, 0.15]))
    times = DT * np.arange(num_steps)
    pieces = rules.network.town.pieces
    ways = [w for p in pieces for w in p.footways if _is_near(w) and len(w) > 20]
    beside, across = [], []
    for _ in range(int(generator.poisson(amount)) if ways else 0):
        line = ways[int(generator.integers(len(ways)))]
        line = line[:: int(generator.choice([-1, 1]))]
        station = generator.uniform(0.0, 0.9) * float(stations(line)[-1])
        speed = generator.uniform(*SPEED)
        if generator.uniform() < 0.25:
            speed = 0.0
        beside.append(walking(line, station, speed, _size(generator), times))
    crossings = [
        (number, arm)
        for number, piece in enumerate(pieces)
        for arm, crossing in enumerate(piece.crossings)
        if _is_near(crossing.line)
    ]
    for _ in range(int(generator.poisson(0.7 * amount)) if crossings else 0):
        number, arm = crossings[int(generator.integers(len(crossings)))]
        walker = _crossing(generator, rules, number, arm, times)
        if walker is not None:
            across.append(walker)
    return beside, across


def is_walked(
    rules: Rules, across: list[Mover], num_steps: int
) -> Bool[np.ndarray, "steps walks_plus_1"]:
    """Tells at which passages of crosswalks somebody is near or will soon be.

    The last column belongs to no passage.
    """
    result = np.zeros((num_steps, len(rules.walk_point) + 1), bool)
    for walker in across:
        gap = walker.xy[:, None] - rules.walk_point
        near = gap[..., 0] ** 2 + gap[..., 1] ** 2 < NEAR**2
        result[:, :-1] |= near & walker.is_there[:, None]
    soon = np.cumsum(result, axis=0)
    ahead = np.concatenate([soon[BEFORE:], np.repeat(soon[-1:], BEFORE, axis=0)])
    return (ahead - soon > 0) | result


def _crossing(
    generator: np.random.Generator,
    rules: Rules,
    number: int,
    arm: int,
    times: Float[np.ndarray, " steps"],
) -> Mover | None:
    """Draws somebody who crosses an arm, if the lights leave time."""
    piece = rules.network.town.pieces[number]
    crossing = piece.crossings[arm]
    length = float(stations(crossing.line)[-1])
    line = crossing.line[:: int(generator.choice([-1, 1]))]
    size = _size(generator)
    for _ in range(DRAWS):
        speed = generator.uniform(*SPEED)
        station = generator.uniform(-speed * times[-1], length)
        if crossing.group is None or _is_safe(
            rules, number, arm, (station + speed * times, length)
        ):
            return walking(line, station, speed, size, times)
    return None


def _is_safe(
    rules: Rules, number: int, arm: int, course: tuple[np.ndarray, float]
) -> bool:
    """Tells if the arm's own lights are red while somebody is on the road.

    Args:
        rules: the town.
        number: of the piece.
        arm: that is crossed.
        course: where the pedestrian is at each step, and the length of its way [m].
    """
    network = rules.network
    at, length = course
    is_on = (at > -MARGIN) & (at < length + MARGIN)
    base = int(network.town.first_lane[number])
    for lane in network.town.pieces[number].ports[arm].begins:
        light = network.light[base + lane]
        is_red = ~signals.goes(network.light_state[light])
        is_red &= ~signals.warns(network.light_state[light])
        if (is_on & ~is_red).any():
            return False
    return True


def _is_near(line: Line) -> bool:
    middle = line[len(line) // 2]
    return bool(middle[0] ** 2 + middle[1] ** 2 < SIGHT**2)


def _size(generator: np.random.Generator) -> Float[np.ndarray, " 3"]:
    width = generator.uniform(0.7, 1.05)
    return np.round([width, width, generator.uniform(1.5, 1.9)], 3)
