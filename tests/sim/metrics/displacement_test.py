"""Tests the distance to the log against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.metrics import displacement
from tests import changes, worlds
from tests.oracles import metrics as oracle


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_displacements_are_those_of_the_oracle(kind: str) -> None:
    for scenario, moment, measures in worlds.samples(kind):
        tracks, step = scenario.tracks, int(moment.step)
        num_objects = len(moment.after.valid)
        order = worlds.order_of(scenario, num_objects)
        log_xy, log_valid = np.zeros((num_objects, 2)), np.zeros(num_objects, bool)
        log_valid[: len(order)] = tracks.valid[order, step]
        log_xy[: len(order)] = (tracks.xyz[order, step] - scenario.origin)[:, :2]
        expected, defined = oracle.displacement(
            np.asarray(moment.after.xy, np.float64),
            np.asarray(moment.after.valid),
            log_xy,
            log_valid,
        )
        measured = measures["log_displacement"]
        np.testing.assert_array_equal(measured.valid, defined)
        np.testing.assert_allclose(
            measured.value, expected, rtol=0, atol=worlds.ROUNDING
        )


def test_where_the_log_has_nobody_there_is_no_displacement() -> None:
    moment = worlds.samples("generated")[0].moment
    nobody = jnp.zeros_like(moment.logged.valid)
    gone = worlds.filled(moment.logged.replace(valid=nobody), 3.0)
    measured = worlds.measure(moment.replace(logged=gone))["log_displacement"]
    assert not np.any(measured.valid)
    np.testing.assert_array_equal(measured.value, 0)


def test_the_gradient_is_finite_on_the_log_and_without_one() -> None:
    moment = worlds.samples("generated")[0].moment
    on_log = moment.replace(after=moment.logged)

    def total(xyz: jax.Array) -> jax.Array:
        moved = on_log.replace(after=on_log.after.replace(xyz=xyz))
        numbers = jnp.arange(len(xyz))
        measures = jax.vmap(displacement.measure, in_axes=(None, 0))(moved, numbers)
        return jnp.sum(measures.value)

    gradient = jax.grad(total)(on_log.after.xyz)
    np.testing.assert_array_equal(gradient, np.zeros_like(gradient))
    away = jax.grad(total)(on_log.after.xyz + 1)
    here = np.asarray(on_log.after.valid)
    np.testing.assert_allclose(away[here, :2], np.sqrt(0.5), rtol=1e-3)


@pytest.mark.parametrize("change", changes.CHANGES)
def test_displacements_are_kept(change: str) -> None:
    changes.assert_kept(change, "log_displacement", worlds.ROUNDING)
