"""Tests returns against hand-worked numbers, plain loops and rlax."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import returns
from drivetrain.learners.returns import Course

NUM_STEPS = 40
ROUNDING = 1e-5  # float32 sums over tens of steps of order one
GAMMA, DECAY = 0.9, 0.8


def course(seed: int) -> tuple[Course, np.ndarray]:
    """Draws episodes that terminate, are settled or are cut, and ratios."""
    rng = np.random.default_rng(seed)
    ended = rng.random(NUM_STEPS) < 0.2
    ended[1:] &= ~ended[:-1]
    shown = np.append(False, ended[:-1])
    terminated = ended & (rng.random(NUM_STEPS) < 0.5)
    settled = ~ended & (rng.random(NUM_STEPS) < 0.2)
    mask = ~shown
    found = Course(
        reward=jnp.float32(np.where(mask, rng.normal(size=NUM_STEPS), 0)),
        discount=jnp.float32(GAMMA * ~(terminated | settled)),
        value=jnp.float32(rng.normal(size=NUM_STEPS + 1)),
        mask=jnp.array(mask),
    )
    assert terminated.any() and settled.any() and (ended & ~terminated).any()
    return found, np.exp(rng.normal(size=NUM_STEPS, scale=0.5)).astype(np.float32)


def episodes(course: Course) -> list[slice]:
    """Returns the stretches of steps that belong together."""
    mask = np.asarray(course.mask)
    firsts = np.flatnonzero(mask & ~np.append(False, mask[:-1]))
    lasts = np.flatnonzero(mask & ~np.append(mask[1:], False))
    return [slice(a, b + 1) for a, b in zip(firsts, lasts, strict=True)]


def lookaheads(course: Course, part: slice, t: int) -> list[float]:
    """Returns G_n, of n = 1, 2, ... rewards and then the value, of one episode."""
    reward, discount, value = (
        np.asarray(x, np.float64)
        for x in (course.reward, course.discount, course.value)
    )
    found, total, factor = [], 0.0, 1.0
    for k in range(t, part.stop):
        total += factor * reward[k]
        factor *= discount[k]
        found.append(total + factor * value[k + 1])
    return found


def test_advantages_are_a_mean_of_all_lookaheads() -> None:
    # A_t = (1 - l) sum_n l^(n-1) G_n - v_t, with all that is left on the longest.
    given, _ = course(0)
    found = returns.generalized_advantage(given, DECAY)
    expected = np.zeros(NUM_STEPS)
    for part in episodes(given):
        for t in range(part.start, part.stop):
            ahead = lookaheads(given, part, t)
            weight = (1 - DECAY) * DECAY ** np.arange(len(ahead))
            weight[-1] = DECAY ** (len(ahead) - 1)
            expected[t] = weight @ ahead - float(given.value[t])
    np.testing.assert_allclose(found.advantage, expected, atol=ROUNDING)
    target = np.where(given.mask, expected + given.value[:-1], 0)
    np.testing.assert_allclose(found.target, target, atol=ROUNDING)


def test_an_episode_that_is_cut_goes_on_in_its_value_and_one_that_ends_does_not() -> (
    None
):
    # Two steps that end, the end shown, two that are cut, the end shown, and one.
    given = Course(
        reward=jnp.array([1.0, 2.0, 0.0, 1.0, 2.0, 0.0, 4.0]),
        discount=jnp.array([0.5, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5]),
        value=jnp.array([1.0, 1.0, 9.0, 1.0, 1.0, 8.0, 1.0, 6.0]),
        mask=jnp.array([True, True, False, True, True, False, True]),
    )
    found = returns.generalized_advantage(given, 0.5)
    # delta: 1 + .5 - 1 = .5; 2 - 1 = 1; .5; 2 + 4 - 1 = 5; 4 + 3 - 1 = 6.
    np.testing.assert_array_equal(found.advantage, [0.75, 1, 0, 1.75, 5, 0, 6])
    np.testing.assert_array_equal(found.target, [1.75, 2, 0, 2.75, 6, 0, 7])


def test_vtrace_is_its_definition() -> None:
    # v_s = V(s) + sum_t gamma^(t-s) (prod_i<t c_i) rho_t delta_t, of one episode.
    given, ratio = course(1)
    found = returns.vtrace(given, jnp.array(ratio), DECAY)
    reward, discount, value = (
        np.asarray(x, np.float64) for x in (given.reward, given.discount, given.value)
    )
    target, advantage = np.zeros(NUM_STEPS), np.zeros(NUM_STEPS)
    weight = np.minimum(ratio, 1).astype(np.float64)
    for part in episodes(given):
        for s in range(part.start, part.stop):
            trace, total = 1.0, value[s]
            for t in range(s, part.stop):
                delta = reward[t] + discount[t] * value[t + 1] - value[t]
                total += trace * weight[t] * delta
                trace *= discount[t] * DECAY * weight[t]
            target[s] = total
        for s in range(part.start, part.stop):
            ahead = value[s + 1]
            if s + 1 < part.stop:
                ahead = DECAY * target[s + 1] + (1 - DECAY) * value[s + 1]
            advantage[s] = reward[s] + discount[s] * ahead - value[s]
    np.testing.assert_allclose(found.target, target, atol=ROUNDING)
    np.testing.assert_allclose(found.advantage, advantage, atol=ROUNDING)


def test_vtrace_of_those_who_acted_is_the_generalized_advantage() -> None:
    given, _ = course(2)
    on_policy = returns.vtrace(given, jnp.ones(NUM_STEPS), DECAY)
    expected = returns.generalized_advantage(given, DECAY)
    np.testing.assert_allclose(on_policy.target, expected.target, atol=ROUNDING)
    np.testing.assert_allclose(on_policy.advantage, expected.advantage, atol=ROUNDING)


def test_both_are_those_of_rlax() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its imports, which are not ours to mend
        import rlax

    given, ratio = course(3)
    goes_on = DECAY * jnp.append(given.mask[1:], False)
    theirs = rlax.truncated_generalized_advantage_estimation(
        given.reward, given.discount, goes_on, given.value
    )
    ours = returns.generalized_advantage(given, DECAY)
    mask = np.asarray(given.mask)
    np.testing.assert_allclose(ours.advantage[mask], theirs[mask], atol=ROUNDING)

    v_tm1, v_t = given.value[:-1], given.value[1:]
    rho = jnp.array(ratio)
    traced = rlax.vtrace_td_error_and_advantage(
        v_tm1, v_t, given.reward, given.discount, rho, goes_on
    )
    ours = returns.vtrace(given, rho, DECAY)
    np.testing.assert_allclose(
        (ours.target - v_tm1)[mask], traced.errors[mask], atol=ROUNDING
    )
    # Theirs is weighed by the ratio.
    weighed = ours.advantage * jnp.minimum(rho, 1.0)
    np.testing.assert_allclose(weighed[mask], traced.pg_advantage[mask], atol=ROUNDING)


@pytest.mark.parametrize("method", ["gae", "vtrace"])
def test_what_was_done_without_mask_changes_nothing(method: str) -> None:
    given, ratio = course(4)
    shown = ~np.asarray(given.mask)
    ended = np.append(shown[1:], False)
    ends = ended & (np.asarray(given.discount) == 0)

    def worth(given: Course, ratio: np.ndarray):
        if method == "gae":
            return returns.generalized_advantage(given, DECAY)
        return returns.vtrace(given, jnp.array(ratio), DECAY)

    spoilt = given.replace(
        reward=jnp.where(shown, 99.0, given.reward),
        discount=jnp.where(shown, 7.0, given.discount),
        # Values after an end of the task, too.
        value=given.value.at[1:].set(jnp.where(ends, 55.0, given.value[1:])),
    )
    other = np.where(shown, 1e9, ratio).astype(np.float32)
    jax.tree.map(
        np.testing.assert_array_equal, worth(given, ratio), worth(spoilt, other)
    )
