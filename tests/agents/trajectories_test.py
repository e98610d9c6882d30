"""Tests of forecasts by numbers worked by hand."""

import jax.numpy as jnp
import numpy as np

from drivetrain.agents.trajectories import Trajectories

ROUNDING = 1e-5  # float32, values of order one to ten
NORMAL = -0.5 * np.log(2 * np.pi)  # logarithm of the standard normal's peak


def forecast() -> Trajectories:
    """Two modes of two steps: one stands still, one drives ahead and turns."""
    drive = [[1.0, 0.0, 3.0], [2.0, 0.0, 3.0]]
    return Trajectories(
        logits=jnp.log(jnp.array([0.2, 0.6])),
        mean=jnp.array([[[0.0, 0.0, 0.0]] * 2, drive]),
        scale=jnp.array([[[1.0, 1.0, 1.0]] * 2, [[0.5, 2.0, 1.0]] * 2]),
    )


def test_step_densities_by_hand() -> None:
    target = jnp.array([[1.0, 2.0, 0.0], [2.5, 0.0, -3.0]])
    found = forecast().step_log_prob(target)
    turn = 2 * np.pi - 6  # from 3 to -3 the short way round
    expected = [
        [3 * NORMAL - 0.5 - 2, 3 * NORMAL - 0.5 * (6.25 + 9)],
        [3 * NORMAL - 0.5 * (1 + 9), 3 * NORMAL - 0.5 * (1 + turn**2)],
    ]
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_distances_are_means_over_the_steps_that_are_there() -> None:
    target = jnp.array([[3.0, 4.0, 0.0], [jnp.nan, jnp.nan, 0.0]])
    found = forecast().distance(target, jnp.array([True, False]))
    np.testing.assert_allclose(found, [5.0, np.hypot(2, 4)], atol=ROUNDING)
    nothing = forecast().distance(target, jnp.zeros(2, bool))
    np.testing.assert_array_equal(nothing, 0.0)


def test_the_mode_is_the_likeliest_trajectory() -> None:
    np.testing.assert_array_equal(forecast().mode(), forecast().mean[1])
    np.testing.assert_allclose(forecast().probability(), [0.25, 0.75], atol=ROUNDING)
