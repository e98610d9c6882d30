"""Tests of the encoder: what may change its output, and what may not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.encoders.base import Encoder
from drivetrain.agents.encoders.wayformer import Wayformer, WayformerConfig
from drivetrain.sim.observations.base import Observation, TokenGroup

SHAPES = {"ego": (1, 4, 3), "objects": (5, 4, 6), "road": (9, 1, 2)}
CONFIG = WayformerConfig(width=16, num_heads=2, num_latents=3)
ROUNDING = 1e-5  # float32 sums over the tokens, in another order


def observe(seed: int) -> Observation:
    def group(key: jax.Array, shape: tuple[int, ...]) -> TokenGroup:
        value_key, mask_key = jax.random.split(key)
        mask = jax.random.bernoulli(mask_key, 0.7, shape[:2])
        values = jnp.where(mask[..., None], jax.random.normal(value_key, shape), 0)
        return TokenGroup(values=values, mask=mask)

    keys = jax.random.split(jax.random.key(seed), len(SHAPES))
    return {n: group(k, s) for k, (n, s) in zip(keys, SHAPES.items(), strict=True)}


def compiled(wayformer: Wayformer) -> Encoder:
    graphdef, state = nnx.split(wayformer)
    return jax.jit(lambda observation: nnx.merge(graphdef, state)(observation))


@pytest.fixture(name="encoder", scope="module")
def fixture_encoder() -> Encoder:
    return compiled(Wayformer(CONFIG, observe(0), rngs=nnx.Rngs(0)))


@pytest.mark.parametrize("fill", [7.0, -1e6, jnp.nan])
def test_no_result_depends_on_the_fill_of_absent_tokens(
    encoder: Encoder, fill: float
) -> None:
    def filled(group: TokenGroup) -> TokenGroup:
        present = group.mask[..., None]
        return group.replace(values=jnp.where(present, group.values, fill))

    observation = observe(1)
    changed = {name: filled(group) for name, group in observation.items()}
    np.testing.assert_array_equal(encoder(changed), encoder(observation))


def test_absent_tokens_receive_no_gradient(encoder: Encoder) -> None:
    observation = observe(1)

    def total(values: dict[str, jax.Array]) -> jax.Array:
        seen = {n: g.replace(values=values[n]) for n, g in observation.items()}
        return (encoder(seen) ** 3).sum()

    gradient = jax.grad(total)({n: g.values for n, g in observation.items()})
    for name, group in observation.items():
        reached = jnp.any(gradient[name] != 0, axis=-1)
        np.testing.assert_array_equal(reached, group.mask, err_msg=name)


def test_an_observation_of_nothing_is_finite(encoder: Encoder) -> None:
    nothing = jax.tree.map(jnp.zeros_like, observe(1))
    assert jnp.isfinite(encoder(nothing)).all()


def test_the_order_of_tokens_does_not_matter(encoder: Encoder) -> None:
    observation = observe(1)
    flipped = jax.tree.map(lambda leaf: leaf[::-1], observation)
    np.testing.assert_allclose(encoder(flipped), encoder(observation), atol=ROUNDING)


def test_the_order_of_steps_matters(encoder: Encoder) -> None:
    observation = observe(1)
    reversed_ego = jax.tree.map(lambda leaf: leaf[:, ::-1], observation["ego"])
    changed = encoder(observation | {"ego": reversed_ego})
    assert jnp.abs(changed - encoder(observation)).max() > 100 * ROUNDING


def test_the_same_numbers_in_another_group_mean_something_else() -> None:
    group = observe(1)["road"]
    absent = jax.tree.map(jnp.zeros_like, group)
    groups = {"road": group, "route": group}
    encoder = compiled(Wayformer(CONFIG, groups, rngs=nnx.Rngs(0)))
    as_road = encoder({"road": group, "route": absent})
    as_route = encoder({"road": absent, "route": group})
    assert jnp.abs(as_road - as_route).max() > 100 * ROUNDING


def test_a_batch_equals_a_loop(encoder: Encoder) -> None:
    observations = [observe(seed) for seed in range(3)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *observations)
    looped = jnp.stack([encoder(observation) for observation in observations])
    np.testing.assert_allclose(jax.vmap(encoder)(batch), looped, atol=ROUNDING)


def test_a_missing_group_is_named(encoder: Encoder) -> None:
    observation = observe(1)
    del observation["road"]
    with pytest.raises(ValueError, match="road"):
        encoder(observation)
