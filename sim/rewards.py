"""Turns moments and their measures into rewards."""

import math
from collections.abc import Callable, Collection, Mapping

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from . import geometry
from .goals import Goal
from .metrics.base import Measure, Moment, is_any_positive
from .motion import Motion
from .scene import Scene

# Of a moment, an object's number and its measures.
Reward = Callable[[Moment, Int[Array, ""], dict[str, Measure]], Float[Array, ""]]

# Of a scenario, the goals, a motion, its step, and an object's number.
Potential = Callable[
    [Scene, Goal, Motion, Int[Array, ""], Int[Array, ""]], Float[Array, ""]
]

MAX_SPEED_GAP = 40.0  # metres per second, by which N divides the gap of speed

# W 5.2: r = -1[collision] - 1[off-road].
SPARSE = {"collision": -1.0, "offroad": -1.0}


def weighted(weights: Mapping[str, float]) -> Reward:
    """Builds the weighted sum of metrics of the state after the action.

    Args:
        weights: of metrics by name; a measure that is not valid counts as zero.
    """

    def reward(
        moment: Moment, number: Int[Array, ""], measures: dict[str, Measure]
    ) -> Float[Array, ""]:
        del moment, number
        parts = [
            weight * jnp.where(measures[name].valid, measures[name].value, 0.0)
            for name, weight in weights.items()
        ]
        return jnp.sum(jnp.stack(parts))

    return reward


def nocturne_dense() -> Reward:
    """Builds Nocturne's dense reward, of the state after the action.

        r = (80 [goal reached] + 0.2 (1 - d / d_0) + 0.2 (1 - |dv| / 40)
             + 0.2 (1 - |dh| / 2 pi)) / 10

    d is the distance to the goal and d_0 that at the start of the episode; dv and dh
    are what speed and heading differ from the goal's (`definitions.md` section 4).
    Where an episode starts at the goal, and for objects that join later, the part of
    the distance is 0.2; an object that is absent or has no goal gets 0. Needs the
    measure `goal`.
    """

    def reward(
        moment: Moment, number: Int[Array, ""], measures: dict[str, Measure]
    ) -> Float[Array, ""]:
        goal, reached = moment.goal, measures["goal"]
        gap = goal.gap(moment.after, number)
        start = goal.distance[number]
        share = jnp.where(start > 0, gap.distance / jnp.where(start > 0, start, 1.0), 0)
        closeness = 3 - share - gap.speed / MAX_SPEED_GAP - gap.heading / (2 * jnp.pi)
        value = (80 * reached.value + 0.2 * closeness) / 10
        return jnp.where(reached.valid, value, 0.0)

    return reward


def shaped(
    reward: Reward,
    potential: Potential,
    weight: float,
    discount: float,
    ends: Collection[str] = (),
) -> Reward:
    """Adds potential-based shaping to a reward (Ng, Harada & Russell 1999, eq. 2).

        F = w (gamma Phi(s') - Phi(s))

    Where the task ends or is settled Phi(s') counts as 0: then the discounted sum of F
    is -w Phi(s_0) whatever was done, and the best policies stay the best.

    Args:
        reward: to which F is added.
        potential: Phi, in metres.
        weight: w, what a metre is worth.
        discount: gamma, the same as the learner's.
        ends: metrics that end or settle it where they are positive; all are measured.

    Raises:
        ValueError: if the discount lies outside 0 to 1, or the weight is not positive.
    """
    if not 0 < weight < math.inf:
        raise ValueError(f"weight must be positive and finite, got {weight}.")
    if not 0 <= discount <= 1:
        raise ValueError(f"discount must lie between 0 and 1, got {discount}.")

    def shaped_reward(
        moment: Moment, number: Int[Array, ""], measures: dict[str, Measure]
    ) -> Float[Array, ""]:
        scene, goal, step = moment.scene, moment.goal, moment.step
        value_t = potential(scene, goal, moment.before, step - 1, number)
        value_tp1 = potential(scene, goal, moment.after, step, number)
        value_tp1 = jnp.where(is_any_positive(measures, ends), 0.0, value_tp1)
        nearer = discount * value_tp1 - value_t
        return reward(moment, number, measures) + weight * nearer

    return shaped_reward


def nearness_to_goal(
    scene: Scene,
    goal: Goal,
    motion: Motion,
    step: Int[Array, ""],
    number: Int[Array, ""],
) -> Float[Array, ""]:
    """Returns minus the distance to the goal [m]; zero where there is none."""
    del scene, step
    return -_distance(motion, goal.motion, number)


def nearness_to_log(
    scene: Scene,
    goal: Goal,
    motion: Motion,
    step: Int[Array, ""],
    number: Int[Array, ""],
) -> Float[Array, ""]:
    """Returns minus the distance to the logged place [m]; zero where either lacks."""
    del goal
    return -_distance(motion, scene.log_at(step), number)


def _distance(a: Motion, b: Motion, number: Int[Array, ""]) -> Float[Array, ""]:
    valid = a.valid[number] & b.valid[number]
    return jnp.where(valid, geometry.norm(a.xy[number] - b.xy[number]), 0.0)
