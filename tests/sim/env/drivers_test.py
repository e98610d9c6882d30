"""Tests of drivers: chance, and several teams together."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import drivers
from drivetrain.sim.env.base import State
from tests import worlds
from tests.sim.env.planning_test import env_of


def state_of() -> State:
    return env_of("delta").reset(
        worlds.bank("generated"), jnp.int32(0), jax.random.key(0)
    )


def drawn(name: str) -> np.ndarray:
    """Returns the random actions of all objects at many steps."""
    driver = drivers.build_all("random", dynamics.build(name))
    bank, state = worlds.bank("generated"), state_of()
    keys = jax.random.split(jax.random.key(0), 1000)
    act = jax.vmap(lambda key: driver.act((), bank, state, key)[1])
    return np.asarray(act(keys))


def test_random_actions_fill_the_bounds_evenly() -> None:
    spec, action = dynamics.build("bicycle").action_spec, drawn("bicycle")
    share = (action - spec.low) / np.subtract(spec.high, spec.low)
    assert share.min() >= 0 and share.max() <= 1
    # The ten shares of 15000 draws stray by 2.5 %; this is four times as much.
    for feature in range(2):
        counts = np.histogram(share[..., feature], bins=10, range=(0, 1))[0]
        np.testing.assert_allclose(counts / share[..., 0].size, 0.1, rtol=0.1)
    assert np.abs(np.corrcoef(share[..., 0].T) - np.eye(share.shape[1])).max() < 0.2


def test_random_discrete_actions_are_all_that_there_are() -> None:
    action = drawn("bicycle_discrete")
    np.testing.assert_array_equal(np.unique(action), np.arange(13 * 25))


def test_each_team_gets_the_action_of_its_driver() -> None:
    bicycle, delta = dynamics.build("bicycle"), dynamics.build("delta")
    parts = drivers.build_all("coast", bicycle), drivers.build_all("expert", delta)
    driver = drivers.together(*parts)
    bank, state, key = worlds.bank("generated"), state_of(), jax.random.key(0)
    scene = worlds.scene(bank, 0)
    _, actions = driver.act(driver.reset(scene), bank, state, key)
    for part, action in zip(parts, actions, strict=True):
        _, own = part.act(part.reset(scene), bank, state, key)
        np.testing.assert_array_equal(action, own)


@pytest.mark.parametrize("name", ["expert", "random"])
def test_the_driver_of_the_ego_does_what_that_of_all_does(name: str) -> None:
    space = dynamics.build("bicycle_discrete")
    one, all_ = drivers.build(name, space), drivers.build_all(name, space)
    bank, state, key = worlds.bank("generated"), state_of(), jax.random.key(0)
    scene = worlds.scene(bank, 0)
    _, action = one.act(one.reset(scene), bank, state, key)
    _, actions = all_.act(all_.reset(scene), bank, state, key)
    assert action.shape == () and int(action) == int(actions[0])
