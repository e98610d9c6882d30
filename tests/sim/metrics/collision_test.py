"""Tests collisions against the oracle."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests import changes, worlds
from tests.oracles import metrics as oracle

NEAR_TOUCH = 2e-3  # metres by which boxes are made larger and smaller; float32 at 1 km


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_collisions_are_those_of_the_oracle(kind: str) -> None:
    count = 0
    for _, moment, measures in worlds.samples(kind):
        after = moment.after
        size = np.asarray(moment.object_size, np.float64)
        less, more = (
            oracle.collision(
                np.asarray(after.xy, np.float64),
                np.asarray(after.yaw, np.float64),
                size + extra,
                np.asarray(after.valid),
            )
            for extra in (-NEAR_TOUCH, NEAR_TOUCH)
        )
        hit = np.asarray(measures["collision"].value) > 0
        assert ((hit == less) | (hit == more)).all()
        np.testing.assert_array_equal(measures["collision"].valid, after.valid)
        count += hit.sum()
    assert count > 0  # else the samples prove nothing


def test_who_is_alone_collides_with_nobody() -> None:
    moment = worlds.samples("generated")[0].moment
    together = moment.after.replace(xyz=jnp.zeros_like(moment.after.xyz))
    alone = jnp.arange(len(together.valid)) == 0
    measures = worlds.measure(moment.replace(after=together.replace(valid=alone)))
    np.testing.assert_array_equal(measures["collision"].value, 0)
    np.testing.assert_array_equal(measures["collision"].valid, alone)


@pytest.mark.parametrize("change", changes.CHANGES)
def test_collisions_are_kept(change: str) -> None:
    changes.assert_kept(change, "collision", 0)
