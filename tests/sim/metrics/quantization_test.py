"""Tests what the 16-bit numbers of a bank change of the flags, on every second file."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Int

from drivetrain.sim.data import bank as banks, inputs
from drivetrain.sim.data.bank import Bank, Sizes
from drivetrain.sim.data.base import BadRecord
from drivetrain.sim.data.pack import PackConfig
from drivetrain.sim.goals import logged_goal
from drivetrain.sim.metrics.base import Measure, Metric, Moment
from drivetrain.sim.metrics.build import measure_all
from drivetrain.sim.metrics.collision import COLLISION
from drivetrain.sim.metrics.edge_contact import EDGE_CONTACT
from drivetrain.sim.metrics.goal import GOAL
from drivetrain.sim.metrics.kinematics import KINEMATIC
from drivetrain.sim.metrics.offroad import OFFROAD
from drivetrain.sim.metrics.red_light import RED_LIGHT
from drivetrain.sim.metrics.route import OFF_ROUTE
from drivetrain.sim.metrics.smooth import SMOOTH_OFFROAD, SOFTNESS
from drivetrain.sim.metrics.wrong_way import WRONG_WAY
from drivetrain.sim.scene import Scene
from tests import worlds

PATTERNS = ("womd/*.tfrecord", "womd_json/*.json.gz", "nocturne/*.json.gz")
TOUCHES = (COLLISION, EDGE_CONTACT)  # which larger boxes have more of
FLAGS = (*TOUCHES, OFFROAD, OFF_ROUTE, RED_LIGHT, WRONG_WAY, KINEMATIC, GOAL)
START = 10  # the step whose distance to the goal counts
LAST = 89  # the step up to which every log goes

EXACT = PackConfig(quantize=False)
QUANTIZED = PackConfig(simplify=0.0)  # 16 bits alone change anything
USUAL = PackConfig()
# A line may pass 3 cm beside its points, and each of two numbers be half a cm off along
# both axes; a box is that much wider and longer on both its sides [m].
TIE = 2 * (0.03 + 2 * 0.005 * np.sqrt(2))


class Values(NamedTuple):
    """A metric of all objects at all steps of all scenarios."""

    value: np.ndarray
    valid: np.ndarray


@functools.cache
def bank_of(config: PackConfig) -> Bank:
    """Returns the bank of half of the real scenarios; skips without files."""
    if not worlds.REAL_DATA.exists():
        pytest.skip("the real files of ../shared/data are not here")
    paths = [path for pattern in PATTERNS for path in worlds.REAL_DATA.glob(pattern)]
    records = [
        record
        for path in sorted(paths)[::2]
        for record in inputs.packed_records(path, config)
    ]
    packed = [record for record in records if not isinstance(record, BadRecord)]
    return jax.device_put(banks.build(packed, Sizes.of(packed, 128)))


@functools.cache
def measured(
    config: PackConfig, metrics: tuple[Metric, ...] = FLAGS, wider: float = 0.0
) -> dict[str, Values]:
    """Returns metrics of the logs, of boxes that are wider and longer."""

    @jax.jit
    def play(bank: Bank, index: Int[Array, ""]) -> dict[str, Measure]:
        scene = Scene(bank=bank, index=index)
        goal = logged_goal(scene, scene.log_at(jnp.int32(START)))
        more = jnp.array([wider, wider, 0.0])[None]

        def at(step: Int[Array, ""]) -> dict[str, Measure]:
            logged = scene.log_at(step)
            moment = Moment(
                scene=scene,
                object_size=scene.object_size + more,
                step=step,
                before=scene.log_at(step - 1),
                after=logged,
                logged=logged,
                goal=goal,
            )
            return measure_all(moment, metrics)

        return jax.lax.map(at, jnp.arange(1, LAST + 1))

    bank = bank_of(config)
    played = [play(bank, jnp.int32(index)) for index in range(len(bank.centre))]
    measures = jax.tree.map(lambda *leaves: np.stack(leaves), *played)
    return {name: Values(m.value, m.valid) for name, m in measures.items()}


def test_quantized_banks_agree_on_999_of_1000_flags() -> None:
    exact, quantized = measured(EXACT), measured(QUANTIZED)
    compared, apart = {}, {}
    for name in exact:
        there = exact[name].valid | quantized[name].valid
        differ = exact[name].value != quantized[name].value
        differ |= exact[name].valid != quantized[name].valid
        compared[name], apart[name] = int(there.sum()), int((there & differ).sum())
    assert min(compared.values()) > 1000
    assert sum(apart.values()) < 1e-3 * sum(compared.values()), apart


@pytest.mark.parametrize("name", [metric.name for metric in TOUCHES])
def test_simplified_quantized_banks_change_touches_that_are_near_ties(
    name: str,
) -> None:
    """Boxes that are smaller by a tie have no more of them, larger ones no fewer."""
    ours = measured(USUAL)[name]
    smaller, larger = (measured(EXACT, TOUCHES, by)[name] for by in (-TIE, TIE))
    np.testing.assert_array_equal(ours.valid, smaller.valid)
    assert np.all(smaller.value <= ours.value) and np.all(ours.value <= larger.value)
    assert np.any(ours.value != measured(EXACT)[name].value)


def test_simplified_quantized_banks_change_off_roads_that_are_near_ties() -> None:
    """The farthest corner is nearer than a tie to its edge, by the smooth cost."""
    ours, exact = (measured(config)[OFFROAD.name] for config in (USUAL, EXACT))
    (cost,) = measured(EXACT, (SMOOTH_OFFROAD,)).values()
    changed = exact.valid & (ours.value != exact.value)
    assert changed.sum() > 10
    farthest = SOFTNESS * np.log(np.expm1(cost.value[changed] / SOFTNESS))
    np.testing.assert_array_less(np.abs(farthest), TIE / 2)
