"""Tests of the plain encoder against its equation, and of its masks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.encoders.flat import FlatConfig, FlatEncoder
from drivetrain.sim.observations.base import Observation, TokenGroup

ROUNDING = 1e-5  # float32 sums of a dozen terms of order one


def observation(fill: float = 0.0) -> Observation:
    objects = TokenGroup(
        values=jnp.array([[[1.0, 2.0]], [[fill, fill]]]),
        mask=jnp.array([[True], [False]]),
    )
    ego = TokenGroup(values=jnp.array([[[3.0]]]), mask=jnp.array([[True]]))
    return {"objects": objects, "ego": ego}


@pytest.mark.parametrize(
    ("activation", "function"),
    [("tanh", np.tanh), ("relu", lambda x: np.maximum(x, 0))],
)
def test_layers_follow_their_equation(activation, function) -> None:
    config = FlatConfig(widths=(5, 4), activation=activation)
    encoder = FlatEncoder(config, observation(), rngs=nnx.Rngs(0))
    # Groups by name: the ego, its mask, the objects, their masks; values over ten.
    x = np.array([0.3, 1.0, 0.1, 0.2, 0.0, 0.0, 1.0, 0.0])
    for layer in encoder.layers:
        layer.bias[...] = jnp.linspace(-1.0, 1.0, layer.out_features)
        x = function(x @ np.asarray(layer.kernel[...]) + np.asarray(layer.bias[...]))
    np.testing.assert_allclose(encoder(observation()), x, atol=ROUNDING)


@pytest.mark.parametrize("fill", [7.0, jnp.nan])
def test_no_result_depends_on_the_fill_of_absent_tokens(fill: float) -> None:
    encoder = FlatEncoder(FlatConfig(widths=(4,)), observation(), rngs=nnx.Rngs(0))
    np.testing.assert_array_equal(encoder(observation(fill)), encoder(observation()))


def test_a_thing_at_the_origin_is_not_nothing() -> None:
    encoder = FlatEncoder(FlatConfig(widths=(4,)), observation(), rngs=nnx.Rngs(0))
    present = jax.tree.map(jnp.copy, observation())
    present["objects"] = present["objects"].replace(mask=jnp.ones((2, 1), bool))
    assert (encoder(present) != encoder(observation())).any()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"activation": "than"}, "unknown activation 'than'; did you mean 'tanh'"),
        ({"widths": (4, 0)}, "widths must be one number of at least 1 per layer"),
        ({"widths": ()}, "widths must be one number of at least 1 per layer"),
        ({"scale": 0.0}, "scale must be a positive number, got 0.0"),
    ],
)
def test_impossible_configs_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FlatConfig(**fields)
