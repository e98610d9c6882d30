"""Tests that the moments of returns are those of all that were seen, on all devices."""

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.learners import mesh as meshes, normalizer as normalizers
from drivetrain.learners.normalizer import Normalizer
from drivetrain.learners.program import BY_DEVICE, EVERYWHERE

ROUNDING = 1e-5  # relative: float32 sums of some hundred numbers


def see(normalizer: Normalizer, values: jax.Array, mask: jax.Array) -> Normalizer:
    """Shows values to a normalizer."""

    def run(normalizer: Normalizer, values: jax.Array, mask: jax.Array) -> Normalizer:
        return normalizers.see(normalizer, values, mask, meshes.AXIS)

    mesh = meshes.data_mesh()
    specs = EVERYWHERE, BY_DEVICE, BY_DEVICE
    on_mesh = jax.shard_map(run, mesh=mesh, in_specs=specs, out_specs=EVERYWHERE)
    return jax.jit(on_mesh)(normalizer, values, mask)


def test_moments_are_those_of_all_that_were_seen() -> None:
    rng = np.random.default_rng(0)
    values = 1000 + 3 * rng.normal(size=(5, 8, 20)).astype(np.float32)
    mask = rng.random(values.shape) < 0.6
    mask[2] = False  # nothing is seen at one time
    normalizer = normalizers.begin()
    for part, seen in zip(values, mask, strict=True):
        shown = jnp.array(np.where(seen, part, np.nan))
        normalizer = see(normalizer, shown, jnp.array(seen))
    right = values[mask].astype(np.float64)
    assert normalizer.count == len(right)
    np.testing.assert_allclose(normalizer.mean, right.mean(), rtol=ROUNDING)
    # At 1000 float32 steps by 6e-5, so a deviation of 3 has five digits.
    np.testing.assert_allclose(normalizer.deviation(), right.std(), rtol=10 * ROUNDING)


def test_two_values_by_hand() -> None:
    normalizer = see(normalizers.begin(), jnp.full((8, 1), 4.0), jnp.ones((8, 1), bool))
    normalizer = see(normalizer, jnp.full((8, 1), 10.0), jnp.ones((8, 1), bool))
    assert normalizer.mean == 7 and normalizer.deviation() == 3
    np.testing.assert_array_equal(normalizer.normalize(jnp.array([1.0, 7.0])), [-2, 0])
    np.testing.assert_array_equal(normalizer.restore(jnp.array([-2.0, 0.0])), [1, 7])


def test_what_was_seen_long_ago_fades() -> None:
    normalizer, everything = normalizers.begin(), jnp.ones((8, 1), bool)
    later = 10
    for value in [0.0] * 100 + [10.0] * later:
        normalizer = see(normalizer, jnp.full((8, 1), value), everything)
    left = (1 - normalizers.LEAST_SHARE) ** later
    np.testing.assert_allclose(normalizer.mean, 10 * (1 - left), rtol=ROUNDING)
    # Of a mixture of tens and noughts, in the shares of what is left of each.
    expected = 10 * np.sqrt(left * (1 - left))
    np.testing.assert_allclose(normalizer.deviation(), expected, rtol=1e-3)


def test_one_that_has_seen_nothing_changes_nothing() -> None:
    values = jnp.array([-3.0, 5.0])
    np.testing.assert_array_equal(normalizers.begin().normalize(values), values)
    np.testing.assert_array_equal(normalizers.begin().restore(values), values)


def test_constant_returns_are_normalized_to_finite_numbers() -> None:
    normalizer = see(normalizers.begin(), jnp.full((8, 1), 4.0), jnp.ones((8, 1), bool))
    assert normalizer.normalize(jnp.float32(4.0)) == 0
    assert normalizer.deviation() == jnp.float32(normalizers.LEAST_DEVIATION)
