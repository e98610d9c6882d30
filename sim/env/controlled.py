"""Says which objects of a scenario a team controls, and who has a seat to act from."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .. import geometry, ranges
from ..metrics.build import EGO
from ..scenario import ObjectType
from ..scene import Scene
from .base import Controls, State
from .starts import lot_key

LOTS = 1  # the number of drawing parts of a set
ROUNDING = 1e-4  # of places: sums of fractions, times some hundred objects, in float32


def ego(scene: Scene) -> Bool[Array, " objects"]:
    """Returns the mask of the ego."""
    mask = scene.object_mask
    return mask & (jnp.arange(len(mask)) == EGO)


def everyone(scene: Scene) -> Bool[Array, " objects"]:
    """Returns the mask of all objects."""
    return scene.object_mask


def nobody(scene: Scene) -> Bool[Array, " objects"]:
    """Returns the mask of no object."""
    return jnp.zeros_like(scene.object_mask)


def of_type(*kinds: ObjectType) -> Controls:
    """Builds the set of all objects of some types.

    Pedestrians and cyclists want other dynamics than cars: give each its team.
    """

    def controls(scene: Scene) -> Bool[Array, " objects"]:
        is_kind = scene.object_type[:, None] == jnp.array(kinds)[None]
        return scene.object_mask & jnp.any(is_kind, axis=1)

    return controls


vehicles = of_type(ObjectType.VEHICLE)
pedestrians = of_type(ObjectType.PEDESTRIAN)
cyclists = of_type(ObjectType.CYCLIST)


@dataclasses.dataclass(frozen=True, kw_only=True)
class MovingConfig:
    """Which vehicles Nocturne hands to its agents (N 4.1)."""

    min_speed: float = 0.05  # metres per second, exceeded at some logged step
    min_distance: float = 0.2  # metres to the goal, exceeded at the start
    max_objects: int = 20  # the first ones; the bank sorts by importance to the ego

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            ValueError: if a threshold is negative, or nobody would be controlled.
        """
        ranges.require_at_least(self, min_speed=0, min_distance=0, max_objects=1)


def moving_vehicles(config: MovingConfig = MovingConfig()) -> Controls:
    """Builds the set of the vehicles that are there at the start, move and could.

    A vehicle moves if it is ever faster than a speed or starts farther from its goal
    than a distance. It could if the log itself reaches the goal on the road (N app. E).
    """

    def controls(scene: Scene) -> Bool[Array, " objects"]:
        start = scene.log_at(scene.current_step)
        log = jax.vmap(scene.log_at)(jnp.arange(scene.bank.sizes.num_steps))
        moves = jnp.max(log.speed, axis=0) > config.min_speed
        away = geometry.norm(scene.log_end().xy - start.xy) > config.min_distance
        mask = vehicles(scene) & start.valid & scene.goal_feasible & (moves | away)
        return mask & (jnp.cumsum(mask) <= config.max_objects)

    return controls


def num_actors(max_actors: int | None, num_objects: int) -> int:
    """Returns how many actors a world of so many objects has, empty seats included."""
    return num_objects if max_actors is None else min(max_actors, num_objects)


def actors(max_actors: int | None, state: State) -> Int[Array, " actors"]:
    """Returns the numbers of the objects that may act in an episode.

    Args:
        max_actors: of a world: so many seats, for whom the teams control; None: one for
            each object.
        state: of the world.

    Returns:
        The numbers, rising; that of no object where a seat is empty, the count of all.
    """
    num_objects = len(state.admitted)
    seats = num_actors(max_actors, num_objects)
    if seats == num_objects:
        return jnp.arange(num_objects)
    (numbers,) = jnp.nonzero(state.controlled, size=seats, fill_value=num_objects)
    return numbers


def share(controls: Controls, fraction: float, first: float = 0.0) -> Controls:
    """Builds the set of a random part of another set, drawn for each episode.

    The n of the set are put in a random order, as places 0, 1/n, 2/n, ... below 1; the
    part are those in [first, first + fraction). Parts one after another share the set
    out, and one from 0 on is never empty unless the set is.

    Args:
        controls: the whole set.
        fraction: how much of it.
        first: where the part begins, such as at the end of another one.

    Raises:
        ValueError: if the part is not within 0 and 1.
    """
    if not (0 <= first and 0 <= fraction and first + fraction <= 1 + ROUNDING):
        raise ValueError(
            f"a share must lie within 0 and 1, got {fraction} from {first} on."
        )

    def part(scene: Scene) -> Bool[Array, " objects"]:
        mask = controls(scene)
        lots = jax.random.uniform(lot_key(scene, LOTS), mask.shape)
        lots = jnp.where(mask, lots, jnp.inf)
        rank = jnp.sum(lots[None] < lots[:, None], axis=1)  # among those of the set
        count = jnp.sum(mask)
        begun = rank >= _first_place(first, count)
        return mask & begun & (rank < _first_place(first + fraction, count))

    return part


def _first_place(boundary: float, count: Int[Array, ""]) -> Int[Array, ""]:
    """Returns the first of so many places that is not before a boundary."""
    return jnp.ceil(boundary * count - ROUNDING).astype(jnp.int32)
