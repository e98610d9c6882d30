"""Tests of the learning-rate schedule and of one step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.learners import mesh as meshes, optim
from drivetrain.learners.base import Metrics, TrainState, one
from drivetrain.learners.optim import OptimizerConfig
from drivetrain.learners.program import EVERYWHERE

ROUNDING = 1e-6  # relative, of float32
CORRECTION = 2e-5  # relative: Adam divides by 1 - 0.999, three digits fewer


@pytest.mark.parametrize(
    ("warmup", "decay", "step", "fraction"),
    [
        (0, None, 0, 1.0),
        (0, None, 999, 1.0),
        (10, None, 0, 0.0),
        (10, None, 5, 0.5),
        (10, None, 50, 1.0),
        (0, 100, 0, 1.0),
        (0, 100, 50, 0.5),
        (10, 110, 5, 0.5),
        (10, 110, 10, 1.0),
        (10, 110, 60, 0.5),  # half of the cosine after the warm-up
        (10, 110, 110, 0.0),
    ],
)
def test_the_rate_warms_up_then_stays_or_follows_a_cosine(
    warmup: int, decay: int | None, step: int, fraction: float
) -> None:
    config = OptimizerConfig(
        learning_rate=2e-3, warmup_updates=warmup, decay_updates=decay
    )
    rate = optim.adam(config).learning_rate(step)
    np.testing.assert_allclose(rate, 2e-3 * fraction, rtol=ROUNDING, atol=1e-10)


def test_the_first_step_of_adam_is_the_rate_against_the_sign() -> None:
    # Both moments are corrected for their start, so that m / sqrt(v) is the sign.
    optimizer = optim.adam(OptimizerConfig(learning_rate=0.5, max_gradient_norm=0.1))
    params = {"w": jnp.array([1.0, 2.0])}
    before = TrainState(
        params=params,
        opt_state=optimizer.transformation.init(params),
        step=jnp.zeros((), jnp.int32),
        key=jax.random.key(0),
    )

    def loss(params: dict[str, jax.Array], slope: jax.Array) -> tuple[Metrics, None]:
        return {"loss": one(params["w"] @ slope)}, None

    def step(before: TrainState) -> tuple[TrainState, Metrics]:
        slope = jnp.array([3.0, -4.0])
        after, metrics, _ = optim.descend(optimizer, before, meshes.AXIS, loss, slope)
        return after, metrics

    on_one = jax.shard_map(
        step, mesh=meshes.data_mesh(), in_specs=EVERYWHERE, out_specs=EVERYWHERE
    )
    after, metrics = jax.jit(on_one)(before)
    np.testing.assert_allclose(after.params["w"], [0.5, 2.5], rtol=CORRECTION)
    np.testing.assert_allclose(metrics["gradient_norm"].total, 5.0, rtol=ROUNDING)
    np.testing.assert_allclose(metrics["gradient_norm/w"].total, 5.0, rtol=ROUNDING)
    assert after.step == 1


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"learning_rate": 0.0}, "must be positive"),
        ({"warmup_updates": -1}, "must not be negative"),
        ({"warmup_updates": 5, "decay_updates": 5}, "must exceed it"),
    ],
)
def test_values_out_of_range_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        optim.adam(OptimizerConfig(**fields))
