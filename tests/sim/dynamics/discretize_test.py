"""Tests discrete actions against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.dynamics.base import Continuous
from drivetrain.sim.dynamics.bicycle import bicycle
from drivetrain.sim.dynamics.delta import LOCAL_HIGH, LOCAL_LOW, delta
from drivetrain.sim.dynamics.discretize import discretize, to_action, to_index
from tests import worlds
from tests.oracles import dynamics as oracle

DT = 0.1
GRIDS = [
    (Continuous((-6.0, -0.3), (6.0, 0.3)), (13, 25)),
    (Continuous(LOCAL_LOW, LOCAL_HIGH), (21, 21, 31)),
]
NEAR_TIE = 1e-4  # of a bin; float32 rounding of the place between two bins


def is_tie(action: np.ndarray, spec: Continuous, bins: tuple[int, ...]) -> bool:
    """Tells whether some feature lies between two bins."""
    low, high = np.array(spec.low), np.array(spec.high)
    place = (action - low) / (high - low) * (np.array(bins) - 1)
    return bool((np.abs(place % 1 - 0.5) < NEAR_TIE).any())


@pytest.mark.parametrize(("spec", "bins"), GRIDS)
def test_the_index_is_that_of_the_oracle(spec: Continuous, bins) -> None:
    rng = np.random.default_rng(0)
    wide = 1.3 * np.array([spec.low, spec.high])  # some lie beyond the bounds
    action = rng.uniform(*wide, (1000, len(bins))).astype(np.float32)
    index = to_index(jnp.asarray(action), spec, bins)
    for i in range(len(action)):
        expected = oracle.discretize(np.float64(action[i]), spec.low, spec.high, bins)
        assert index[i] == expected or is_tie(action[i], spec, bins)


@pytest.mark.parametrize(("spec", "bins"), GRIDS)
def test_the_action_is_that_of_the_oracle(spec: Continuous, bins) -> None:
    index = np.arange(0, np.prod(bins), 7)
    action = to_action(jnp.asarray(index), spec, bins)
    expected = [oracle.undiscretize(int(i), spec.low, spec.high, bins) for i in index]
    np.testing.assert_allclose(action, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("spec", "bins"), GRIDS)
def test_every_index_survives_its_action(spec: Continuous, bins) -> None:
    index = jnp.arange(np.prod(bins))
    back = jax.jit(lambda i: to_index(to_action(i, spec, bins), spec, bins))(index)
    np.testing.assert_array_equal(back, index)


def test_halves_go_to_the_even_bin() -> None:
    spec = Continuous((0.0,), (4.0,))
    action = jnp.array([[0.5], [1.5], [2.5], [3.5]])
    assert to_index(action, spec, (5,)).tolist() == [0, 2, 2, 4]


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_the_inverse_is_the_nearest_action_of_the_continuous_one(kind: str) -> None:
    before, after = worlds.kicked_pairs(kind)
    spec, bins = GRIDS[0]
    continuous = np.asarray(
        bicycle().inverse(before, after, worlds.car_size(before), DT)
    )
    discrete = discretize(bicycle(), bins)
    index = jax.jit(discrete.inverse)(before, after, worlds.car_size(before), DT)
    for i in range(len(index)):
        expected = oracle.discretize(
            np.float64(continuous[i]), spec.low, spec.high, bins
        )
        assert index[i] == expected or is_tie(continuous[i], spec, bins)


def test_discrete_dynamics_are_not_made_discrete_again() -> None:
    with pytest.raises(ValueError, match="discrete already"):
        discretize(discretize(bicycle(), (13, 25)), (13, 25))


@pytest.mark.parametrize("bins", [(13,), (13, 1), (3, 3, 3)])
def test_bins_that_do_not_fit_are_refused(bins: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="bins must be 2 numbers"):
        discretize(bicycle(), bins)


def test_a_step_is_that_of_the_grid_point() -> None:
    before, _ = worlds.kicked_pairs("generated")
    spec, bins = GRIDS[1]
    index = jnp.arange(len(before.yaw)) * 11
    discrete = discretize(delta("local"), bins).forward(
        before, worlds.car_size(before), index, DT
    )
    action = to_action(index, spec, bins)
    continuous = delta("local").forward(before, worlds.car_size(before), action, DT)
    np.testing.assert_array_equal(discrete.xyz, continuous.xyz)
