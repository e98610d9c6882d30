"""Tests the figures of an episode against a plain loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.metrics import aggregate
from drivetrain.sim.metrics.base import Measure

FLAGS = ("collision", "offroad", "offroute", "kinematic")
FLAGS += ("wrong_way", "red_light", "edge_contact", "goal")
NAMES = (*FLAGS, "log_displacement", "progress")
NUM_STEPS = 12
ROUNDING = 1e-5  # float32, a sum of a dozen numbers below 10


def measures(seed: int, share_valid: float, fill: float = 7.0) -> dict[str, Measure]:
    """Returns random measures; where not valid, they hold the fill."""
    rng = np.random.default_rng(seed)
    made = {}
    for name in NAMES:
        valid = rng.random(NUM_STEPS) < share_valid
        value = rng.uniform(0, 5, NUM_STEPS)
        if name in FLAGS:
            value = (rng.random(NUM_STEPS) < 0.15).astype(float)
        value = np.where(valid, value, fill)
        made[name] = Measure(
            value=jnp.asarray(value, jnp.float32), valid=jnp.asarray(valid)
        )
    return made


def by_loop(steps: dict[str, Measure]) -> dict[str, float | None]:
    """Returns the figures, None where there is nothing to count."""
    kept = {
        name: [float(v) for v, ok in zip(m.value, m.valid, strict=True) if ok]
        for name, m in steps.items()
    }
    figures = {name: float(any(kept[name])) if kept[name] else None for name in FLAGS}
    displacement, progress = kept["log_displacement"], kept["progress"]
    figures["log_ade"] = sum(displacement) / len(displacement) if displacement else None
    figures["log_fde"] = displacement[-1] if displacement else None
    figures["progress"] = progress[-1] if progress else None
    return figures


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("share_valid", [0.0, 0.15, 0.8, 1.0])
def test_figures_are_those_of_a_loop(seed: int, share_valid: float) -> None:
    steps = measures(seed, share_valid)
    episode, expected_figures = aggregate.summarize(steps), by_loop(steps)
    assert set(episode.value) == set(expected_figures)
    for name, figure in expected_figures.items():
        assert bool(episode.valid[name]) == (figure is not None)
        expected = 0.0 if figure is None else figure
        assert float(episode.value[name]) == pytest.approx(expected, abs=ROUNDING)


def test_what_is_not_measured_has_no_figure() -> None:
    steps = measures(5, 0.7)
    episode = aggregate.summarize({name: steps[name] for name in ("goal", "progress")})
    assert set(episode.value) == set(episode.valid) == {"goal", "progress"}


def test_what_is_not_valid_does_not_count() -> None:
    zeros, junk = (aggregate.summarize(measures(3, 0.4, x)) for x in (0.0, np.nan))
    for one, other in zip(jax.tree.leaves(zeros), jax.tree.leaves(junk), strict=True):
        np.testing.assert_array_equal(one, other)


def test_steps_after_the_end_change_nothing() -> None:
    steps = measures(4, 0.7)
    longer = jax.tree.map(lambda leaf: jnp.pad(leaf, (0, 5)), steps)
    for one, other in zip(
        jax.tree.leaves(aggregate.summarize(steps)),
        jax.tree.leaves(aggregate.summarize(longer)),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, atol=ROUNDING)
