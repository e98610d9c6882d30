"""States who drives and in which manner, and how they follow each other."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

HARDEST = 5.0  # metres per second squared of braking, under the 6 of the bicycle
LINE_GAP = 1.0  # metres to a line at which IDM comes to rest


@dataclasses.dataclass(frozen=True, kw_only=True)
class Drivers:
    """Cars and bicycles with their drivers; the symbols are those of IDM."""

    size: Float[np.ndarray, "drivers 3"]  # length, width, height [m]
    is_cyclist: Bool[np.ndarray, " drivers"]
    desired: Float[np.ndarray, " drivers"]  # v0, as a share of the speed limit
    top_speed: Float[np.ndarray, " drivers"]  # metres per second
    headway: Float[np.ndarray, " drivers"]  # T [s]
    acceleration: Float[np.ndarray, " drivers"]  # a [m/s^2]
    braking: Float[np.ndarray, " drivers"]  # b [m/s^2]
    standstill: Float[np.ndarray, " drivers"]  # s0 [m]
    aside: Float[np.ndarray, " drivers"]  # lateral acceleration in bends [m/s^2]
    reaction: Float[np.ndarray, " drivers"]  # seconds in which the foot follows
    courtesy: Float[np.ndarray, " drivers"]  # p of MOBIL


def draw(
    generator: np.random.Generator, is_cyclist: Bool[np.ndarray, " drivers"]
) -> Drivers:
    """Draws sizes and manners; a tenth are vans, and now and then a truck."""
    num = len(is_cyclist)
    kind = generator.uniform(size=num)[:, None]
    car = generator.uniform([4.2, 1.85, 1.4], [5.1, 2.2, 1.9], (num, 3))
    van = generator.uniform([5.2, 2.0, 1.9], [6.2, 2.4, 2.8], (num, 3))
    truck = generator.uniform([7.0, 2.4, 2.8], [11.0, 2.7, 3.6], (num, 3))
    bicycle = generator.uniform([1.65, 0.6, 1.6], [1.95, 0.9, 1.9], (num, 3))
    size = np.where(kind < 0.03, truck, np.where(kind < 0.15, van, car))
    return Drivers(
        size=np.round(np.where(is_cyclist[:, None], bicycle, size), 3),
        is_cyclist=is_cyclist,
        desired=generator.uniform(0.85, 1.2, num),
        top_speed=np.where(is_cyclist, generator.uniform(3.0, 6.5, num), 40.0),
        headway=generator.uniform(0.9, 2.0, num),
        acceleration=generator.uniform(1.1, 2.4, num),
        braking=generator.uniform(1.4, 2.8, num),
        standstill=generator.uniform(1.5, 3.5, num),
        aside=generator.uniform(1.2, 2.8, num),
        reaction=generator.uniform(0.15, 0.5, num),
        courtesy=generator.uniform(0.1, 0.5, num),
    )


def free(
    drivers: Drivers,
    speed: Float[np.ndarray, " drivers"],
    desired: Float[np.ndarray, " drivers"],
) -> Float[np.ndarray, " drivers"]:
    """Returns a [1 - (v / v0)^4], IDM's acceleration on a free road [m/s^2].

    Who is too fast brakes by no more than b.
    """
    share = speed / desired
    share = share * share
    return np.maximum(drivers.acceleration * (1 - share * share), -drivers.braking)


def interaction(
    drivers: Drivers,
    speed: Float[np.ndarray, "*any drivers"],
    gap: Float[np.ndarray, "*any drivers"],
    closing: Float[np.ndarray, "*any drivers"],
) -> Float[np.ndarray, "*any drivers"]:
    """Returns a (s* / s)^2 with s* = s0 + v T + v dv / (2 sqrt(a b)) [m/s^2].

    This is what IDM (Treiber, Hennecke and Helbing 2000, eq. 2 and 3) takes away for a
    leader.

    Args:
        drivers: who follows.
        speed: their speeds v [m/s].
        gap: from bumper to bumper s [m].
        closing: dv, how much slower the leader is [m/s].
    """
    rooted = 2 * np.sqrt(drivers.acceleration * drivers.braking)
    wanted = speed * drivers.headway + speed * closing / rooted
    wanted = drivers.standstill + np.maximum(wanted, 0.0)
    share = wanted / np.maximum(gap, 0.1)
    return drivers.acceleration * share * share


def halt(
    drivers: Drivers,
    speed: Float[np.ndarray, " drivers"],
    distance: Float[np.ndarray, " drivers"],
) -> Float[np.ndarray, " drivers"]:
    """Returns what IDM takes away for a line at which to stop [m/s^2].

    The line is a leader that stands; T is left out but for the last second, so that
    cars come to rest near it.
    """
    rooted = 2 * np.sqrt(drivers.acceleration * drivers.braking)
    wanted = LINE_GAP + 0.6 * speed + speed * speed / rooted
    share = wanted / np.maximum(distance, 0.1)
    return drivers.acceleration * share * share
