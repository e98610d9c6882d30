"""Tests of attention along the axes of a scene: who can take note of whom."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.encoders.attention import AttentionBlock
from drivetrain.agents.encoders.scene_attention import (
    SceneAttention,
    attended_axes,
    flat,
)
from drivetrain.agents.encoders.tokens import Tokens

WIDTH = 8
TOKENS, STEPS = 3, 4


@pytest.mark.parametrize(
    ("attention", "num_steps", "axes"),
    [
        ("multi_axis", 1, "tokens tokens tokens tokens"),
        ("factorized_sequential", 11, "steps steps tokens tokens"),
        ("factorized_interleaved", 11, "steps tokens steps tokens"),
        ("factorized_interleaved", 1, "tokens tokens"),
    ],
)
def test_half_of_the_layers_attend_along_time(
    attention: str, num_steps: int, axes: str
) -> None:
    assert attended_axes(attention, 4, num_steps) == tuple(axes.split())


def scene() -> Tokens:
    values = jax.random.normal(jax.random.key(0), (TOKENS, STEPS, WIDTH))
    return Tokens(values=values, mask=jnp.ones((TOKENS, STEPS), bool))


def encoder(*axes: str) -> SceneAttention:
    rngs = nnx.Rngs(0)
    return SceneAttention(axes, None, lambda: AttentionBlock(WIDTH, 2, 1, rngs=rngs))


def reach(encoder: SceneAttention, token: int, step: int) -> np.ndarray:
    """Returns which places of the output change with one place of the input."""
    before = scene()
    after = before.replace(values=before.values.at[token, step, 0].add(1.0))
    change = encoder.attend(after).values - encoder.attend(before).values
    return np.asarray((change != 0).any(axis=-1))


def test_along_time_a_token_sees_itself_alone() -> None:
    expected = np.zeros((TOKENS, STEPS), bool)
    expected[1] = True
    np.testing.assert_array_equal(reach(encoder("steps"), 1, 2), expected)


def test_along_space_a_step_sees_itself_alone() -> None:
    expected = np.zeros((TOKENS, STEPS), bool)
    expected[:, 2] = True
    np.testing.assert_array_equal(reach(encoder("tokens"), 1, 2), expected)


def test_both_axes_together_reach_everything() -> None:
    assert reach(encoder("steps", "tokens"), 1, 2).all()


def test_a_flat_scene_runs_through_steps_first() -> None:
    tokens = flat(scene())
    assert tokens.values.shape == (TOKENS * STEPS, 1, WIDTH)
    np.testing.assert_array_equal(tokens.values[5, 0], scene().values[1, 1])


def test_latents_that_find_no_token_are_there_all_the_same() -> None:
    rngs = nnx.Rngs(0)
    module = SceneAttention(
        (),
        nnx.Embed(2, WIDTH, rngs=rngs),
        lambda: AttentionBlock(WIDTH, 2, 1, rngs=rngs),
    )
    empty = scene().replace(mask=jnp.zeros((TOKENS, STEPS), bool))
    found = module.attend(empty)
    assert found.values.shape == (2, STEPS, WIDTH)
    assert found.mask.all()
    assert jnp.isfinite(found.values).all()
