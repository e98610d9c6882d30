"""Merges the many trajectories of a forecast into the few most likely ones."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..sim import geometry
from .trajectories import Trajectories

TIE = 1e-5  # of the probability covered: float32 sums in another order differ so much
TINY = 1e-30  # probability of a mode that stands for nothing; its logarithm is finite


def aggregate(
    trajectories: Trajectories,
    num_modes: int,
    threshold: float,
    num_refinements: int,
) -> Trajectories:
    """Chooses modes that cover much probability, then moves them among their own.

    One mode after the other is chosen, the one with the most probability not yet
    covered within the threshold of its end point. Then, as in k-means, each of all
    modes goes to the chosen one whose end point is nearest, and the chosen become the
    means of what came to them (Nayakanti et al. 2022 after Varadarajan et al. 2021, who
    share modes out softly, by expectation maximization).

    Args:
        trajectories: the forecast.
        num_modes: to keep.
        threshold: how far apart end points of one manoeuvre may be [m].
        num_refinements: how often modes go and means are taken; 0 leaves the chosen
            modes as they are, with their own probabilities rescaled.

    Returns:
        The modes in the order of their choice. Probabilities are sums, and scales those
        of the mixtures that the modes stand for.

    Raises:
        ValueError: if there are fewer modes than are to be kept.
    """
    num_given = trajectories.logits.shape[0]
    if not 1 <= num_modes <= num_given:
        raise ValueError(
            f"num_modes must be between 1 and the {num_given} of the forecast, got "
            f"{num_modes}."
        )
    chosen = cover(trajectories, num_modes, threshold)
    kept = jax.tree.map(lambda leaf: leaf[chosen], trajectories)
    return jax.lax.fori_loop(
        0, num_refinements, lambda _, modes: _refined(modes, trajectories), kept
    )


def cover(
    trajectories: Trajectories, num_modes: int, threshold: float
) -> Int[Array, " chosen"]:
    """Returns the numbers of modes that greedily cover the most probability.

    Of those that cover as much, such as two that cover each other, the most likely is
    chosen; so they follow by probability once all is covered.
    """
    probability = trajectories.probability()
    is_near = _end_distance(trajectories, trajectories) <= threshold

    def choose(carry, _):
        uncovered, is_chosen = carry
        gain = jnp.sum(jnp.where(is_near, uncovered[None], 0.0), axis=1)
        gain = jnp.where(is_chosen, -1.0, gain)
        is_best = gain >= gain.max() * (1 - TIE)
        best = jnp.argmax(jnp.where(is_best & ~is_chosen, probability, -1.0))
        uncovered = jnp.where(is_near[best], 0.0, uncovered)
        return (uncovered, is_chosen.at[best].set(True)), best

    start = (probability, probability < 0)  # none; on devices as the probability is
    _, chosen = jax.lax.scan(choose, start, length=num_modes)
    return chosen


def _refined(modes: Trajectories, given: Trajectories) -> Trajectories:
    """Returns the modes as means of the given ones whose end points are nearest."""
    nearest = jnp.argmin(_end_distance(given, modes), axis=1)
    share = jax.nn.one_hot(nearest, modes.logits.shape[0], axis=0)
    share = share * given.probability()[None]
    total = share.sum(axis=1)
    stands_for_some = (total > 0)[:, None, None]
    weight = share / jnp.where(total > 0, total, 1.0)[:, None]

    # About the mode's present place, so that yaws are averaged the short way round.
    offset = given.mean[None] - modes.mean[:, None]
    offset = offset.at[..., 2].set(geometry.wrap_angle(offset[..., 2]))
    shift = jnp.einsum("km,kmsf->ksf", weight, offset)
    spread = given.scale[None] ** 2 + (offset - shift[:, None]) ** 2
    scale = jnp.sqrt(jnp.einsum("km,kmsf->ksf", weight, spread))
    return Trajectories(
        logits=jnp.log(jnp.maximum(total, TINY)),
        mean=modes.mean + shift,
        scale=jnp.where(stands_for_some, scale, modes.scale),
    )


def _end_distance(a: Trajectories, b: Trajectories) -> Float[Array, "a b"]:
    """Returns how far the end points of two forecasts are from each other [m]."""
    return geometry.norm(a.mean[:, None, -1, :2] - b.mean[None, :, -1, :2])
