"""Tests of the merging of modes, by hand and against plain loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents import modes
from drivetrain.agents.trajectories import Trajectories

ROUNDING = 1e-4  # float32, positions up to 50 m and sums of squares about the mean
STEPS = 5


def forecast(seed: int, num_modes: int = 24) -> Trajectories:
    """Draws trajectories that end in a dozen places, some near each other."""
    keys = jax.random.split(jax.random.key(seed), 4)
    ends = 4 * jax.random.normal(keys[0], (num_modes, 1, 3))
    ramp = jnp.linspace(0.2, 1.0, STEPS)[None, :, None]
    wobble = 0.1 * jax.random.normal(keys[1], (num_modes, STEPS, 3))
    return Trajectories(
        logits=2 * jax.random.normal(keys[2], (num_modes,)),
        mean=ends * ramp + wobble,
        scale=jax.random.uniform(keys[3], (num_modes, STEPS, 3), minval=0.1, maxval=2),
    )


def line(ends: list[float], probability: list[float]) -> Trajectories:
    """Returns trajectories of one step straight ahead."""
    mean = jnp.zeros((len(ends), 1, 3)).at[:, 0, 0].set(jnp.array(ends))
    logits = jnp.log(jnp.array(probability))
    return Trajectories(logits=logits, mean=mean, scale=jnp.ones_like(mean))


def test_a_group_of_modes_beats_the_likeliest_single_one() -> None:
    given = line([10.0, 0.0, 1.0, 20.0], [0.35, 0.25, 0.3, 0.1])
    np.testing.assert_array_equal(modes.cover(given, 3, threshold=2.0), [2, 0, 3])


def test_what_is_covered_counts_once() -> None:
    # The first mode covers 0.6 at first, and nothing once its neighbour is chosen.
    given = line([0.0, 1.5, 3.0, 10.0], [0.4, 0.2, 0.1, 0.3])
    np.testing.assert_array_equal(modes.cover(given, 2, threshold=2.0), [1, 3])


def test_the_likeliest_follow_once_all_is_covered() -> None:
    given = line([0.0, 0.1, 0.2, 0.3], [0.2, 0.4, 0.1, 0.3])
    np.testing.assert_array_equal(modes.cover(given, 3, threshold=2.0), [1, 3, 0])


def test_merged_modes_by_hand() -> None:
    given = line([10.0, 0.0, 1.0, 20.0], [0.35, 0.25, 0.35, 0.05])
    found = modes.aggregate(given, 2, threshold=2.0, num_refinements=1)
    # (0, 1) with 0.25 and 0.35, mean 7/12; (10, 20) with 0.35 and 0.05, mean 11.25.
    np.testing.assert_allclose(found.probability(), [0.6, 0.4], atol=ROUNDING)
    np.testing.assert_allclose(found.mean[:, 0, 0], [7 / 12, 11.25], atol=ROUNDING)
    # Variances 1 + w (1 - w) d^2.
    expected = np.sqrt([1 + 35 / 144, 1 + 7 / 64 * 100])
    np.testing.assert_allclose(found.scale[:, 0, 0], expected, atol=ROUNDING)


def test_yaws_are_averaged_the_short_way_round() -> None:
    given = line([0.0, 0.1], [0.5, 0.5])
    given = given.replace(mean=given.mean.at[:, 0, 2].set(jnp.array([3.1, -3.1])))
    found = modes.aggregate(given, 1, threshold=2.0, num_refinements=1)
    assert abs(abs(found.mean[0, 0, 2]) - np.pi) < ROUNDING


def aggregate_in_loops(given: Trajectories, k: int, threshold: float, rounds: int):
    """Returns probabilities, means and scales, in float64."""
    logits, mean, scale = (
        np.asarray(x, float) for x in (given.logits, given.mean, given.scale)
    )
    p = np.exp(logits) / np.exp(logits).sum()

    def apart(a, b) -> float:
        return float(np.hypot(*(a[-1, :2] - b[-1, :2])))

    uncovered, chosen = dict(enumerate(p)), []
    while len(chosen) < k:
        gains = {
            i: sum(
                q for j, q in uncovered.items() if apart(mean[i], mean[j]) <= threshold
            )
            for i in range(len(p))
            if i not in chosen
        }
        ties = [i for i in gains if gains[i] >= max(gains.values()) * (1 - 1e-5)]
        best = max(ties, key=lambda i: p[i])
        chosen.append(best)
        uncovered = {
            j: q for j, q in uncovered.items() if apart(mean[best], mean[j]) > threshold
        }

    centres = [mean[i] for i in chosen]
    for _ in range(rounds):
        members = [[] for _ in centres]
        for j in range(len(p)):
            members[int(np.argmin([apart(mean[j], c) for c in centres]))].append(j)
        totals = [sum(p[j] for j in group) for group in members]
        moved, scales = [], []
        for centre, group, total in zip(centres, members, totals, strict=True):
            offsets = {j: mean[j] - centre for j in group}
            for offset in offsets.values():
                offset[:, 2] = np.angle(np.exp(1j * offset[:, 2]))
            shift = sum(p[j] * offsets[j] for j in group) / total
            spread = (p[j] * (scale[j] ** 2 + (offsets[j] - shift) ** 2) for j in group)
            moved.append(centre + shift)
            scales.append(np.sqrt(sum(spread) / total))
        centres = moved
    return np.array(totals), np.array(centres), np.array(scales)


@pytest.mark.parametrize("seed", range(4))
def test_merging_is_that_of_the_loops(seed: int) -> None:
    given = forecast(seed)
    found = jax.jit(modes.aggregate, static_argnums=(1, 2, 3))(given, 6, 3.0, 3)
    probability, mean, scale = aggregate_in_loops(given, 6, 3.0, 3)
    np.testing.assert_allclose(found.probability(), probability, atol=ROUNDING)
    np.testing.assert_allclose(found.mean, mean, atol=ROUNDING)
    np.testing.assert_allclose(found.scale, scale, atol=ROUNDING)


def test_the_order_of_the_given_modes_does_not_matter() -> None:
    given = forecast(0)
    flipped = jax.tree.map(lambda leaf: leaf[::-1], given)
    one, other = (modes.aggregate(f, 6, 3.0, 3) for f in (given, flipped))
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, atol=ROUNDING), one, other
    )


def test_modes_that_coincide_stay_finite() -> None:
    given = line([1.0] * 4, [0.25] * 4)
    found = modes.aggregate(given, 3, threshold=2.0, num_refinements=2)
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    np.testing.assert_allclose(found.probability(), [1.0, 0.0, 0.0], atol=ROUNDING)


@pytest.mark.parametrize("num_modes", [0, 5])
def test_more_modes_than_given_are_refused(num_modes: int) -> None:
    with pytest.raises(ValueError, match="num_modes must be between 1 and the 4"):
        modes.aggregate(line([0.0] * 4, [0.25] * 4), num_modes, 2.0, 1)
