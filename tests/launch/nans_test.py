"""Tests that the operation is found at which numbers cease."""

import functools

import jax
import jax.numpy as jnp
import pytest

from drivetrain.launch import nans
from drivetrain.learners.base import Bank, Metrics, TrainState, one


def update(train_state: TrainState, bank: Bank) -> tuple[TrainState, Metrics]:
    """Takes one away, and as the loss the logarithm of what is left."""
    left = train_state.params - 1.0
    loss = one(jnp.log(left))
    metrics = {"loss": loss, "gradient_norm": one(1.0)}
    return train_state.replace(params=left, step=train_state.step + 1), metrics


def several(
    train_state: TrainState, bank: Bank, count: int
) -> tuple[TrainState, Metrics]:
    return jax.lax.scan(lambda state, _: update(state, bank), train_state, None, count)


def begun(params: float) -> TrainState:
    return TrainState(
        params=jnp.float32(params),
        opt_state=(),
        step=jnp.int32(0),
        key=jax.random.key(0),
    )


def run(params: float) -> tuple[TrainState, list[str]]:
    """Runs three updates in one call; what it says is returned too."""
    said: list[str] = []
    compiled = [
        jax.jit(functools.partial(several, count=count), donate_argnums=0)
        for count in (3, 1)
    ]
    searched = nans.searched(compiled[0], compiled[1], said.append)
    return searched(begun(params), ())[0], said


def test_numbers_that_stay_numbers_go_on_as_they_would() -> None:
    state, said = run(9.0)
    assert float(state.params) == 6
    assert said == []


def test_the_first_line_whose_result_is_no_number_is_named() -> None:
    # After 1.5 and 0.5 the third update takes the logarithm of -0.5.
    wanted = (
        r"tests/launch/nans_test\.py:\d+, in update: loss = one\(jnp\.log\(left\)\)"
    )
    with pytest.raises(nans.NoNumberError, match=wanted):
        run(2.5)
