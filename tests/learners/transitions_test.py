"""Tests that transitions reach as far as they should, and no farther."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners.acting import Step
from drivetrain.learners.transitions import transitions
from drivetrain.sim.observations.base import Observation, TokenGroup

ROUNDING = 1e-6  # relative, float32 sums of a few products


def see(number: np.ndarray) -> Observation:
    """Shows a number, that of the step."""
    values = jnp.asarray(number, jnp.float32)[..., None, None, None]
    return {"clock": TokenGroup(values=values, mask=jnp.ones(values.shape[:-1], bool))}


def told(seen: Observation) -> np.ndarray:
    return np.asarray(seen["clock"].values)[:, 0, 0, 0]


def steps_of(
    reward: np.ndarray, discount: np.ndarray, ended: np.ndarray, mask: np.ndarray
) -> Step:
    return Step(
        observation=see(np.arange(len(reward))),
        action=jnp.arange(len(reward), dtype=jnp.int32),
        note=(),
        reward=jnp.asarray(reward, jnp.float32),
        discount=jnp.asarray(discount, jnp.float32),
        mask=jnp.asarray(mask),
        ended=jnp.asarray(ended),
        measures={},
    )


def test_returns_of_two_steps_equal_those_worked_by_hand() -> None:
    # An episode that is terminated at step 2 and shown at 3; one cut at 5, shown at 6.
    steps = steps_of(
        reward=np.array([1.0, 2.0, 4.0, 0.0, 8.0, 16.0, 0.0, 32.0, 64.0]),
        discount=np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
        ended=np.isin(np.arange(9), [2, 5]),
        mask=~np.isin(np.arange(9), [3, 6]),
    )
    cut, valid = transitions(steps, see(np.array(9)), num_steps=2, discount=0.5)
    # What follows the last step is not known yet.
    real = np.flatnonzero(valid)
    np.testing.assert_array_equal(real, [0, 1, 2, 4, 5, 7])
    np.testing.assert_array_equal(told(cut.observation_t), np.arange(8))
    np.testing.assert_array_equal(cut.action_t, np.arange(8))
    # 1 + 2/2, 2 + 4/2, 4 at the end; 8 + 16/2, 16 at the cut; 32 + 64/2.
    np.testing.assert_array_equal(cut.return_t[real], [2, 4, 4, 16, 16, 64])
    np.testing.assert_array_equal(cut.discount_tpn[real], [0.25, 0, 0, 0.25, 0.5, 0.25])
    np.testing.assert_array_equal(told(cut.observation_tpn)[real], [2, 3, 3, 6, 6, 9])


@pytest.mark.parametrize("num_steps", [1, 3, 7])
def test_transitions_equal_those_of_a_plain_loop(num_steps: int) -> None:
    rng, total, gamma = np.random.default_rng(num_steps), 60, 0.9
    ended = rng.random(total) < 0.2
    ended[1:] &= ~ended[:-1]
    mask = np.append(True, ~ended[:-1])
    # 0 where an episode is terminated, and where it goes on but is settled.
    discount = np.where(rng.random(total) < np.where(ended, 0.5, 0.2), 0.0, 1.0)
    reward = np.where(mask, rng.normal(size=total), 0.0)
    steps = steps_of(reward, discount, ended, mask)
    cut_all = functools.partial(transitions, num_steps=num_steps, discount=gamma)
    cut, valid = jax.jit(cut_all)(steps, see(np.array(total)))

    known = mask[: total - num_steps + 1]
    np.testing.assert_array_equal(valid, known)
    for start in np.flatnonzero(known):
        return_t, factor, t = 0.0, 1.0, start
        while t < start + num_steps:
            return_t += factor * float(steps.reward[t])
            factor *= gamma * discount[t]
            t += 1
            if ended[t - 1]:
                break
        found = cut.return_t[start], cut.discount_tpn[start]
        np.testing.assert_allclose(found, (return_t, factor), rtol=ROUNDING, atol=1e-6)
        assert told(cut.observation_tpn)[start] == t
