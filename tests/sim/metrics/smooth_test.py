"""Tests the smooth costs against the oracle, by hand, and at their edges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.metrics import smooth
from drivetrain.sim.metrics.base import Measure, Metric, Moment
from tests import worlds
from tests.oracles import smooth as oracle
from tests.oracles.geometry import Box

ROUNDING = 2e-3  # metres; see `worlds.ROUNDING`, for a sum over two dozen boxes
FINE = 1e-5  # metres; float32 near the origin, a few operations
METRICS = (smooth.SMOOTH_COLLISION, smooth.SMOOTH_OFFROAD)


@jax.jit
def measured(moment: Moment) -> tuple[Measure, ...]:
    """Returns both costs of all objects."""
    numbers = jnp.arange(len(moment.after.valid))
    return tuple(
        jax.vmap(metric.measure, in_axes=(None, 0))(moment, numbers)
        for metric in METRICS
    )


def boxes(moment: Moment) -> list[Box]:
    """Returns the boxes after the step in float64."""
    after, size = moment.after, np.float64(moment.object_size)
    xy, yaw = np.float64(after.xy), np.float64(after.yaw)
    return [Box(xy[i], yaw[i], *size[i, :2]) for i in range(len(yaw))]


def two_cars(offset: tuple[float, float], turn: float = 0.0) -> Moment:
    """Returns a moment of two cars of 4 m by 2 m, the second off the first."""
    moment = worlds.samples("generated")[0].moment
    count = len(moment.after.valid)
    first = moment.after.xyz[0]
    shift = jnp.array([*offset, 0.0])
    after = moment.after.replace(
        xyz=jnp.tile(first, (count, 1)).at[1].add(shift) - first[None],
        yaw=jnp.zeros(count).at[1].set(turn),
        valid=jnp.arange(count) < 2,
    )
    size = jnp.tile(jnp.array([4.0, 2.0, 1.5]), (count, 1))
    return moment.replace(after=after, object_size=size)


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_the_cost_of_a_collision_is_that_of_the_oracle(kind: str) -> None:
    deep = 0
    for sample in worlds.samples(kind):
        cost, _ = measured(sample.moment)
        valid = np.asarray(sample.moment.after.valid)
        np.testing.assert_array_equal(cost.valid, valid)
        box = boxes(sample.moment)
        for i in range(len(box)):
            others = [box[j] for j in np.flatnonzero(valid) if j != i]
            expected = oracle.collision(box[i], others, smooth.SOFTNESS) * valid[i]
            assert cost.value[i] == pytest.approx(expected, abs=ROUNDING)
            deep += expected > 1
    assert deep > 0  # else the samples prove nothing


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_the_cost_of_leaving_the_road_is_that_of_the_oracle(kind: str) -> None:
    found = []
    for sample in worlds.samples(kind):
        _, cost = measured(sample.moment)
        edges = worlds.edges_of(sample.scenario)
        box, z = boxes(sample.moment), np.float64(sample.moment.after.xyz[:, 2])
        for i in np.flatnonzero(sample.moment.after.valid)[:4]:
            assert cost.valid[i]
            expected = oracle.offroad(box[i], z[i], edges, smooth.SOFTNESS)
            assert cost.value[i] == pytest.approx(expected, abs=ROUNDING)
            found.append(expected > 0.7 * smooth.SOFTNESS)
    assert 0 < np.mean(found) < 1  # else the samples prove nothing


@pytest.mark.parametrize(
    ("offset", "turn", "depth"),
    [
        ((3.5, 0.0), 0.0, 0.5),
        ((0.0, -1.5), 0.0, 0.5),  # the other way out is 4 m
        ((4.0, 0.0), 0.0, 0.0),
        ((4.5, 1.0), 0.0, -0.5),
        ((3.25, 0.0), np.pi / 2, -0.25),
        # Its nearest corner is 3 / sqrt 2 before its centre.
        ((4.0, 0.0), np.pi / 4, 3 / np.sqrt(2) - 2),
    ],
)
def test_two_cars_by_hand(
    offset: tuple[float, float], turn: float, depth: float
) -> None:
    cost, _ = measured(two_cars(offset, turn))
    expected = 0.25 * np.log1p(np.exp(depth / 0.25))
    np.testing.assert_allclose(cost.value[:2], expected, rtol=0, atol=FINE)
    np.testing.assert_array_equal(cost.value[2:], 0)


def test_the_gradient_parts_the_cars() -> None:
    def cost(x: jax.Array) -> jax.Array:
        moment = two_cars((0.0, 0.0))
        xyz = moment.after.xyz.at[1, 0].set(x)
        moved = moment.replace(after=moment.after.replace(xyz=xyz))
        return smooth.collision(moved, jnp.int32(0)).value

    # The slope of the softened length is 1 / (1 + exp(-x / s)).
    expected = -1 / (1 + np.exp(-0.5 / 0.25))
    assert float(jax.grad(cost)(jnp.float32(3.5))) == pytest.approx(expected, abs=FINE)
    assert float(jax.grad(cost)(jnp.float32(-3.5))) == pytest.approx(
        -expected, abs=FINE
    )


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
@pytest.mark.parametrize("case", ["coincident", "alone", "absent", "no road"])
def test_gradients_are_finite_at_the_edges(metric: Metric, case: str) -> None:
    moment = two_cars((0.0, 0.0))
    count = {"alone": 1, "absent": 0}.get(case, 2)
    present = jnp.arange(len(moment.after.valid)) < count
    moment = moment.replace(after=moment.after.replace(valid=present))
    if case == "no road":
        bare = worlds.with_edges(worlds.scenarios("generated")[0], [np.zeros((1, 3))])
        bank = worlds.bank_of([worlds.exact(bare)])
        moment = moment.replace(scene=worlds.scene(bank, 0))
        assert not smooth.offroad(moment, jnp.int32(0)).valid

    def cost(xyz: jax.Array, yaw: jax.Array) -> jax.Array:
        moved = moment.replace(after=moment.after.replace(xyz=xyz, yaw=yaw))
        return metric.measure(moved, jnp.int32(0)).value

    value, gradients = jax.value_and_grad(cost, argnums=(0, 1))(
        moment.after.xyz, moment.after.yaw
    )
    assert np.isfinite(value)
    assert all(np.isfinite(gradient).all() for gradient in gradients)
