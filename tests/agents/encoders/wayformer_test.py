"""Tests of the encoder: what may change its output, and what may not."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drivetrain.agents.encoders.base import Encoder
from drivetrain.agents.encoders.wayformer import Wayformer, WayformerConfig
from drivetrain.sim.observations.base import Observation, TokenGroup
from tests.oracles import wayformer as oracle

SHAPES = {"ego": (1, 4, 3), "objects": (5, 4, 6), "road": (9, 1, 2)}
CONFIG = WayformerConfig(width=16, num_heads=2, num_latents=3)
ROUNDING = 1e-5  # float32 sums over the tokens, in another order
# Each product of bfloat16 numbers is off by 2^-8 of itself; the errors of the 20 or so
# layers in a row are as often up as down, and outputs are of order one.
BFLOAT16_ROUNDING = 2**-8 * np.sqrt(20)
FUSIONS = ("early", "late", "hierarchical")
ATTENTIONS = ("multi_axis", "factorized_sequential", "factorized_interleaved")


def member(fusion: str, attention: str, num_latents: int) -> WayformerConfig:
    return WayformerConfig(
        width=8,
        num_heads=2,
        num_layers=4,
        num_latents=num_latents,
        fusion=fusion,
        attention=attention,
    )


MEMBERS = [
    *(member(*names, 3) for names in itertools.product(FUSIONS, ATTENTIONS)),
    *(member(*names, 0) for names in zip(FUSIONS, ATTENTIONS, strict=True)),
]
UNLIKE_MEMBERS = [
    member("early", "multi_axis", 0),
    member("early", "factorized_sequential", 3),
    member("late", "factorized_interleaved", 0),
    member("hierarchical", "factorized_interleaved", 3),
]


def observe(seed: int) -> Observation:
    def group(key: jax.Array, shape: tuple[int, ...]) -> TokenGroup:
        value_key, mask_key = jax.random.split(key)
        mask = jax.random.bernoulli(mask_key, 0.7, shape[:2])
        values = jnp.where(mask[..., None], jax.random.normal(value_key, shape), 0)
        return TokenGroup(values=values, mask=mask)

    keys = jax.random.split(jax.random.key(seed), len(SHAPES))
    return {n: group(k, s) for k, (n, s) in zip(keys, SHAPES.items(), strict=True)}


def named(config: WayformerConfig) -> str:
    return f"{config.fusion}-{config.attention}-{config.num_latents}"


def kicked(wayformer: Wayformer) -> Wayformer:
    """Moves every parameter, for biases start at zero and agree with any use there."""
    state = nnx.state(wayformer)
    leaves, treedef = jax.tree.flatten(state)
    keys = jax.random.split(jax.random.key(9), len(leaves))
    moved = [
        x + 0.3 * jax.random.normal(k, x.shape)
        for k, x in zip(keys, leaves, strict=True)
    ]
    nnx.update(wayformer, jax.tree.unflatten(treedef, moved))
    return wayformer


def filled(observation: Observation, fill: float) -> Observation:
    def fill_absent(group: TokenGroup) -> TokenGroup:
        present = group.mask[..., None]
        return group.replace(values=jnp.where(present, group.values, fill))

    return {name: fill_absent(group) for name, group in observation.items()}


def stacked(observations: list[Observation]) -> Observation:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *observations)


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
    observation = observe(1)
    changed = filled(observation, fill)
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
    batch = stacked(observations)
    looped = jnp.stack([encoder(observation) for observation in observations])
    np.testing.assert_allclose(jax.vmap(encoder)(batch), looped, atol=ROUNDING)


def test_a_missing_group_is_named(encoder: Encoder) -> None:
    observation = observe(1)
    del observation["road"]
    with pytest.raises(ValueError, match="road"):
        encoder(observation)


def test_the_default_draws_and_computes_what_it_always_did() -> None:
    # Trained parameters are out there. The numbers are of the first encoder, which knew
    # early fusion with latents alone.
    wayformer = Wayformer(WayformerConfig(), observe(0), rngs=nnx.Rngs(0))
    names = nnx.to_pure_dict(nnx.state(wayformer))
    assert sorted(names) == ["blocks", "cross", "latents", "norm", "tokens"]
    assert sorted(names["tokens"]["groups"]["ego"]) == ["projection", "step_embedding"]
    np.testing.assert_allclose(
        compiled(wayformer)(observe(1))[:4],
        [-0.3196291923, -1.8621941805, 0.0021281375, 0.2402551323],
        atol=ROUNDING,
    )


@pytest.mark.parametrize("config", MEMBERS, ids=named)
def test_members_mind_what_is_there_and_nothing_else(config: WayformerConfig) -> None:
    observation = observe(1)
    cases = stacked(
        [
            observation,
            filled(observation, jnp.nan),
            jax.tree.map(lambda leaf: leaf[::-1], observation),
            observation | {"road": observe(2)["road"]},
            jax.tree.map(jnp.zeros_like, observation),
        ]
    )
    encoder = compiled(Wayformer(config, observation, rngs=nnx.Rngs(0)))
    plain, with_fill, flipped, elsewhere, nothing = jax.jit(jax.vmap(encoder))(cases)

    np.testing.assert_array_equal(with_fill, plain)
    np.testing.assert_allclose(flipped, plain, atol=ROUNDING)
    assert jnp.abs(elsewhere - plain).max() > 100 * ROUNDING
    assert jnp.isfinite(nothing).all()


def expected(config: WayformerConfig, params: dict, observation: Observation):
    """Encodes by the oracle; the road has one step, the others have four."""
    layers = config.num_layers // (2 if config.fusion == "hierarchical" else 1)
    heads = config.num_heads
    axes = {
        "multi_axis": ["space"] * layers,
        "factorized_sequential": ["time"] * (layers // 2) + ["space"] * (layers // 2),
        "factorized_interleaved": ["time", "space"] * (layers // 2),
    }[config.attention]
    scenes, steps = [], []
    for name in sorted(observation):
        group = observation[name].values, observation[name].mask
        scene = oracle.embed(params["tokens"]["groups"][name], group)
        steps.append(1 if config.attention == "multi_axis" else SHAPES[name][1])
        if config.attention == "multi_axis":
            scene = oracle.flatten(scene)
        if config.fusion != "early":
            own = axes if SHAPES[name][1] > 1 else [a for a in axes if a == "space"]
            scene = oracle.encode(params["own"][name], scene, own, heads, steps[-1])
        scenes.append(oracle.flatten(scene) if config.fusion == "late" else scene)
    if config.fusion == "late":
        return oracle.pool(params, oracle.join(scenes, [0] * len(steps), 1))
    joint = oracle.join(scenes, steps, max(steps))
    return oracle.pool(params, oracle.encode(params, joint, axes, heads, max(steps)))


@pytest.mark.parametrize("config", UNLIKE_MEMBERS, ids=named)
def test_members_compute_what_loops_compute(config: WayformerConfig) -> None:
    config = dataclasses.replace(config, positions=True)
    wayformer = kicked(Wayformer(config, observe(0), rngs=nnx.Rngs(0)))
    params = jax.tree.map(
        lambda leaf: np.asarray(leaf, np.float64),
        nnx.to_pure_dict(nnx.state(wayformer)),
    )
    np.testing.assert_allclose(
        compiled(wayformer)(observe(1)),
        expected(config, params, jax.tree.map(np.asarray, observe(1))),
        atol=ROUNDING,
    )


def test_positions_make_the_order_of_tokens_matter() -> None:
    config = dataclasses.replace(CONFIG, positions=True)
    encoder = compiled(Wayformer(config, observe(0), rngs=nnx.Rngs(0)))
    flipped = jax.tree.map(lambda leaf: leaf[::-1], observe(1))
    assert jnp.abs(encoder(flipped) - encoder(observe(1))).max() > 100 * ROUNDING


@pytest.mark.parametrize("latents", [0, 3])
def test_the_embedding_is_the_mean_of_the_tokens_that_are_there(latents: int) -> None:
    config = dataclasses.replace(CONFIG, num_latents=latents)
    wayformer = Wayformer(config, observe(0), rngs=nnx.Rngs(0))
    tokens, mask = jax.jit(wayformer.encode)(observe(1))
    num_present = sum(int(group.mask.sum()) for group in observe(1).values())
    assert mask.sum() == (latents or num_present)
    np.testing.assert_array_equal(tokens[~mask], 0.0)
    np.testing.assert_allclose(
        tokens[mask].mean(axis=0), compiled(wayformer)(observe(1)), atol=ROUNDING
    )


@pytest.mark.parametrize("latents", [0, 3])
def test_bfloat16_is_near_float32_and_learns_in_float32(latents: int) -> None:
    config = dataclasses.replace(CONFIG, num_latents=latents)
    halved = dataclasses.replace(config, dtype="bfloat16")
    full = Wayformer(config, observe(0), rngs=nnx.Rngs(0))
    graphdef, state = nnx.split(Wayformer(halved, observe(0), rngs=nnx.Rngs(0)))

    def loss(state):
        output = nnx.merge(graphdef, state)(observe(1))
        return (output**3).sum(), output

    (_, output), gradient = jax.jit(jax.value_and_grad(loss, has_aux=True))(state)
    error = jnp.abs(output - compiled(full)(observe(1))).max()
    assert 0 < error < BFLOAT16_ROUNDING
    leaves = jax.tree.leaves((state, gradient, output))
    assert all(leaf.dtype == jnp.float32 for leaf in leaves)
    assert all(jnp.isfinite(leaf).all() for leaf in leaves)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"fusion": "erly"}, "unknown fusion 'erly'; did you mean 'early'?"),
        ({"attention": "factorized"}, "unknown attention 'factorized'"),
        ({"dtype": "float16"}, "unknown dtype 'float16'"),
        ({"num_latents": -1}, "num_latents must be at least 0, got -1"),
        ({"num_layers": 0}, "num_layers must be at least 1, got 0"),
        ({"width": 10, "num_heads": 4}, "num_heads must divide width"),
        (
            {"fusion": "hierarchical", "attention": "factorized_sequential"},
            "num_layers must be a multiple of 4 for hierarchical fusion with",
        ),
    ],
)
def test_impossible_configs_are_refused(fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("?", "[?]")):
        WayformerConfig(**fields)


def test_factorized_attention_needs_one_time_axis() -> None:
    config = dataclasses.replace(CONFIG, attention="factorized_sequential")
    observation = {"ego": observe(0)["ego"]}
    observation["lights"] = jax.tree.map(lambda x: x[:, :3], observation["ego"])
    with pytest.raises(ValueError, match="fuse late"):
        Wayformer(config, observation, rngs=nnx.Rngs(0))
    late = dataclasses.replace(config, fusion="late")
    encoder = compiled(Wayformer(late, observation, rngs=nnx.Rngs(0)))
    assert jnp.isfinite(encoder(observation)).all()
