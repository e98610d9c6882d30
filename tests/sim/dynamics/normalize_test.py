"""Tests actions between -1 and 1."""

import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.dynamics.bicycle import bicycle
from drivetrain.sim.dynamics.delta import LOCAL_HIGH, LOCAL_LOW, delta
from drivetrain.sim.dynamics.discretize import discretize
from drivetrain.sim.dynamics.normalize import normalize
from tests import worlds

DT = 0.1
ROUNDING = 1e-6  # relative; float32, two operations


@pytest.mark.parametrize(
    ("share", "expected"),
    # The bounds are not symmetric: forward by 4 m, backwards by 1 m.
    [
        (-1.0, LOCAL_LOW),
        (1.0, LOCAL_HIGH),
        (0.0, (1.5, 0, 0)),
        (0.5, (2.75, 0.25, 0.15)),
    ],
)
def test_controls_lie_between_the_bounds(
    share: float, expected: tuple[float, ...]
) -> None:
    controls = normalize(delta("local")).controls(jnp.full((2, 3), share))
    np.testing.assert_allclose(controls, [expected] * 2, rtol=ROUNDING, atol=ROUNDING)


def test_a_step_is_that_of_the_controls() -> None:
    before, _ = worlds.kicked_pairs("generated")
    size = worlds.car_size(before)
    rng = np.random.default_rng(0)
    action = jnp.asarray(rng.uniform(-1, 1, (len(before.yaw), 2)), jnp.float32)
    normal = normalize(bicycle())
    after = normal.forward(before, size, action, DT)
    plain = bicycle().forward(before, size, action * jnp.array([[6.0, 0.3]]), DT)
    np.testing.assert_allclose(after.velocity, plain.velocity, rtol=0, atol=1e-5)
    np.testing.assert_allclose(after.yaw, plain.yaw, rtol=0, atol=1e-5)


def test_the_inverse_counts_in_halves_of_the_range() -> None:
    before, after = worlds.kicked_pairs("generated")
    size = worlds.car_size(before)
    action = normalize(bicycle()).inverse(before, after, size, DT)
    plain = bicycle().inverse(before, after, size, DT)
    np.testing.assert_allclose(action * jnp.array([[6.0, 0.3]]), plain, rtol=ROUNDING)


def test_coasting_is_that_of_the_dynamics() -> None:
    before, _ = worlds.kicked_pairs("generated")
    normal, plain = normalize(delta("local")), delta("local")
    controls = normal.controls(normal.coast(before, DT))
    np.testing.assert_allclose(controls, plain.coast(before, DT), rtol=0, atol=1e-5)


def test_discrete_dynamics_are_not_normalized() -> None:
    with pytest.raises(ValueError, match=r"bicycle_discrete is discrete .* normalize"):
        normalize(discretize(bicycle(), (13, 25)))
