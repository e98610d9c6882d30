"""Tests what all dynamics owe: the contract of `base`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim import geometry
from drivetrain.sim.dynamics import build
from drivetrain.sim.dynamics.base import Continuous, Discrete, Dynamics
from drivetrain.sim.motion import Motion
from tests import worlds

DT = 0.1
ROUNDING = 1e-3  # metres; see `worlds.ROUNDING`
NAMES = sorted(build.DYNAMICS)
COASTING = [name for name in NAMES if "discrete" not in name]


def one_action(dynamics: Dynamics, count: int, seed: int) -> jax.Array:
    """Returns actions out of those a policy may choose."""
    rng = np.random.default_rng(seed)
    spec = dynamics.action_spec
    if isinstance(spec, Discrete):
        return jnp.asarray(rng.integers(0, spec.num_actions, count))
    assert isinstance(spec, Continuous)
    action = rng.uniform(spec.low, spec.high, (count, len(spec.low)))
    return jnp.asarray(action, jnp.float32)


@pytest.fixture
def before() -> Motion:
    return worlds.kicked_pairs("generated")[0]


@pytest.mark.parametrize("name", NAMES)
def test_height_and_validity_stay(name: str, before: Motion) -> None:
    dynamics = build.build(name)
    action = one_action(dynamics, len(before.yaw), 0)
    after = dynamics.forward(before, worlds.car_size(before), action, DT)
    np.testing.assert_array_equal(after.xyz[:, 2], before.xyz[:, 2])
    np.testing.assert_array_equal(after.valid, before.valid)


@pytest.mark.parametrize("name", NAMES)
def test_one_object_moves_as_it_does_among_all(name: str, before: Motion) -> None:
    dynamics = build.build(name)
    action = one_action(dynamics, len(before.yaw), 1)
    size, axes = worlds.car_size(before), (0, 0, 0, None)
    together = dynamics.forward(before, size, action, DT)
    apart = jax.vmap(dynamics.forward, in_axes=axes)(before, size, action, DT)
    back = dynamics.inverse(before, together, size, DT)
    back_apart = jax.vmap(dynamics.inverse, in_axes=axes)(before, apart, size, DT)
    for all_, each in zip(
        jax.tree.leaves((together, back)),
        jax.tree.leaves((apart, back_apart)),
        strict=True,
    ):
        np.testing.assert_allclose(each, all_, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_inverse_undoes_forward(name: str, before: Motion) -> None:
    dynamics = build.build(name)
    moving = np.asarray(before.speed) > 2  # a bicycle at rest cannot tell its turn
    before = jax.tree.map(lambda leaf: leaf[moving], before)
    action = one_action(dynamics, len(before.yaw), 2)
    after = dynamics.forward(before, worlds.car_size(before), action, DT)
    again = dynamics.forward(
        before,
        worlds.car_size(before),
        dynamics.inverse(before, after, worlds.car_size(before), DT),
        DT,
    )
    np.testing.assert_allclose(again.xy, after.xy, rtol=0, atol=ROUNDING)
    turn = geometry.wrap_angle(again.yaw - after.yaw)
    np.testing.assert_allclose(turn, 0, atol=1e-5)


@pytest.mark.parametrize("name", COASTING)
def test_coasting_holds_velocity_and_heading(name: str, before: Motion) -> None:
    dynamics = build.build(name)
    heading = geometry.direction(before.yaw)
    rolling = before.replace(velocity=before.speed[:, None] * heading)
    after = dynamics.forward(
        rolling, worlds.car_size(rolling), dynamics.coast(rolling, DT), DT
    )
    np.testing.assert_allclose(after.velocity, rolling.velocity, rtol=0, atol=1e-4)
    np.testing.assert_allclose(
        geometry.wrap_angle(after.yaw - rolling.yaw), 0, atol=1e-5
    )
    moved = rolling.xy + DT * rolling.velocity
    np.testing.assert_allclose(after.xy, moved, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("name", NAMES)
def test_gradients_are_finite_at_rest_in_one_place(name: str) -> None:
    dynamics = build.build(name)
    rest = Motion(
        xyz=jnp.zeros((2, 3)),
        yaw=jnp.zeros(2),
        velocity=jnp.zeros((2, 2)),
        valid=jnp.zeros(2, bool),
    )
    action = dynamics.coast(rest, DT)

    def drive(velocity):
        after = dynamics.forward(
            rest.replace(velocity=velocity), worlds.car_size(rest), action, DT
        )
        return jnp.sum(after.xy) + jnp.sum(after.velocity) + jnp.sum(after.yaw)

    assert np.isfinite(jax.grad(drive)(rest.velocity)).all()
    assert np.isfinite(
        np.asarray(dynamics.inverse(rest, rest, worlds.car_size(rest), DT))
    ).all()


def test_a_wrong_name_is_told_with_its_cure() -> None:
    with pytest.raises(ValueError, match=r"'bicicle'; did you mean 'bicycle'\? Known"):
        build.build("bicicle")
