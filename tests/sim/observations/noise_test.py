"""Tests that what is seen of others is blurred as said, and the viewer exact."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.noise import NoiseConfig, blurred

CONFIG = NoiseConfig(position=0.5, yaw=0.02, velocity=0.3)
NUM_STEPS, NUM_OBJECTS, NUM_KEYS = 3, 20, 300
VIEWER = 4
# Of a deviation estimated from n numbers the standard error is 1 / sqrt(2 n); five.
SPREAD = 5 / (2 * NUM_STEPS * (NUM_OBJECTS - 1) * NUM_KEYS) ** 0.5
STILL = Motion(
    xyz=jnp.zeros((NUM_STEPS, NUM_OBJECTS, 3)),
    yaw=jnp.zeros((NUM_STEPS, NUM_OBJECTS)),
    velocity=jnp.zeros((NUM_STEPS, NUM_OBJECTS, 2)),
    valid=jnp.ones((NUM_STEPS, NUM_OBJECTS), bool),
)


def errors(config: NoiseConfig) -> Motion:
    """Returns the errors of many looks at objects that stand in the origin."""
    keys = jax.random.split(jax.random.key(0), NUM_KEYS)
    look = jax.vmap(lambda key: blurred(config, STILL, jnp.int32(VIEWER), key))
    return jax.jit(look)(keys)


def test_errors_of_others_are_gaussian_with_the_stated_deviations() -> None:
    seen = errors(CONFIG)
    others = np.arange(NUM_OBJECTS) != VIEWER
    for error, deviation in (
        (seen.xyz[..., 0], CONFIG.position),
        (seen.xyz[..., 1], CONFIG.position),
        (seen.yaw, CONFIG.yaw),
        (seen.velocity[..., 0], CONFIG.velocity),
        (seen.velocity[..., 1], CONFIG.velocity),
    ):
        scaled = np.float64(error)[:, :, others] / deviation
        assert abs(scaled.mean()) < SPREAD * 2**0.5
        assert abs(scaled.std() - 1) < SPREAD
        # Of a Gaussian, 68.27 % lie within one deviation.
        assert abs(np.mean(np.abs(scaled) < 1) - 0.6827) < SPREAD
        steps = np.corrcoef(np.swapaxes(scaled, 0, 1).reshape(NUM_STEPS, -1))
        assert np.abs(steps - np.eye(NUM_STEPS)).max() < SPREAD * 6**0.5
    np.testing.assert_array_equal(seen.xyz[..., 2], 0)


def test_the_viewer_knows_its_own_motion() -> None:
    seen = errors(CONFIG)
    for error in (seen.xyz, seen.yaw, seen.velocity):
        np.testing.assert_array_equal(np.asarray(error)[:, :, VIEWER], 0)


def test_each_error_has_its_own_switch() -> None:
    seen = errors(NoiseConfig(yaw=0.1))
    assert np.asarray(seen.yaw).any()
    assert not np.asarray(seen.xyz).any() and not np.asarray(seen.velocity).any()


@pytest.mark.parametrize("name", ["position", "yaw", "velocity"])
@pytest.mark.parametrize("deviation", [-0.1, float("nan"), float("inf")])
def test_a_wrong_deviation_is_told(name: str, deviation: float) -> None:
    with pytest.raises(ValueError, match=f"noise of {name} must be .* got {deviation}"):
        NoiseConfig(**{name: deviation})
