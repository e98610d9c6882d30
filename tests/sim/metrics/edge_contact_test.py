"""Tests the contact with road edges against the oracle."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.metrics.base import Moment
from drivetrain.sim.metrics.edge_contact import edge_contact
from drivetrain.sim.scenario import Scenario
from tests import changes, worlds
from tests.oracles import metrics as oracle
from tests.oracles.geometry import Box

LEVEL = 3.0  # metres


def at_the_edges(moment: Moment, scenario: Scenario, seed: int) -> Moment:
    """Moves everybody to somewhere near a road edge."""
    rng = np.random.default_rng(seed)
    num_objects = len(moment.after.valid)
    xyz = rng.choice(np.concatenate(worlds.edges_of(scenario)), num_objects)
    xyz += rng.normal(0, (2.5, 2.5, 1.5), (num_objects, 3))
    moved = moment.after.replace(xyz=xyz, yaw=rng.uniform(-np.pi, np.pi, num_objects))
    return moment.replace(after=worlds.filled(moved, 0.0))


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_contacts_are_those_of_the_oracle(kind: str) -> None:
    count = []
    for seed, (scenario, moment, _) in enumerate(worlds.samples(kind)):
        moment = at_the_edges(moment, scenario, seed)
        measures = worlds.measure(moment)
        after, size = moment.after, np.float64(moment.object_size)
        segments = oracle.segments_of(worlds.edges_of(scenario))
        touches = np.asarray(measures["edge_contact"].value) > 0
        np.testing.assert_array_equal(measures["edge_contact"].valid, after.valid)
        assert not touches[~np.asarray(after.valid)].any()
        for i in np.flatnonzero(after.valid):
            xy, yaw, z = np.float64(after.xy[i]), float(after.yaw[i]), after.xyz[i, 2]
            less, more = (
                oracle.edge_contact(
                    Box(xy, yaw, *size[i, :2] + extra), float(z), segments, LEVEL
                )
                for extra in (-2 * worlds.ROUNDING, 2 * worlds.ROUNDING)
            )
            assert less <= touches[i] <= more
        count.append(touches[np.asarray(after.valid)])
    assert 0.2 < np.mean(np.concatenate(count)) < 0.8  # else the places prove nothing


@pytest.mark.parametrize(
    ("height", "level", "touches"),
    [
        (0.5, LEVEL, 1),
        (-2.9, LEVEL, 1),
        (3.1, LEVEL, 0),
        (-3.1, LEVEL, 0),
        (40.0, math.inf, 1),
    ],
)
def test_edges_of_another_level_are_passed_over(height, level, touches) -> None:
    edge = np.array([(-9.0, 0, 0), (9, 0, 0)])
    bank = worlds.bank_of(
        [worlds.exact(worlds.with_edges(synthetic.generate(0), [edge]))]
    )
    moment = worlds.moment_of(worlds.scene(bank, 0), 30, 0)
    xyz = moment.after.xyz.at[0].set(jnp.array([3.0, 0.4, height]))
    moved = moment.replace(after=moment.after.replace(xyz=xyz))
    measured = jax.jit(edge_contact(level).measure)(moved, jnp.int32(0))
    assert measured.valid
    assert float(measured.value) == touches


def test_a_map_without_edges_is_touched_nowhere() -> None:
    scenario = worlds.with_edges(synthetic.generate(0), [np.zeros((1, 3))])
    bank = worlds.bank_of([worlds.exact(scenario)])
    moment = worlds.moment_of(worlds.scene(bank, 0), 30, 0)
    contact = worlds.measure(moment)["edge_contact"]
    np.testing.assert_array_equal(contact.value, 0)
    np.testing.assert_array_equal(contact.valid, moment.after.valid)


@pytest.mark.parametrize("change", changes.CHANGES)
def test_contacts_are_kept(change: str) -> None:
    changes.assert_kept(change, "edge_contact", 0)
