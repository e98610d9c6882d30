"""Changes that leave every metric as it was: turned maps, padding, and so on."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim.data import bank as banks
from drivetrain.sim.data.bank import Bank, Sizes
from drivetrain.sim.metrics.base import Measure, Moment
from drivetrain.sim.metrics.build import measure_all
from drivetrain.sim.motion import Motion
from drivetrain.sim.scene import Scene
from tests.worlds import (
    MAX_OBJECTS,
    MOTIONS,
    bank_of,
    exact,
    filled,
    measure,
    rotate,
    samples,
    scenarios,
    turned,
)


def _motions(moment: Moment, change: Callable[[Motion], Motion]) -> dict[str, Motion]:
    return {name: change(getattr(moment, name)) for name in MOTIONS}


def _taken(results: list[dict[str, Measure]], objects: np.ndarray):
    return jax.tree.map(lambda leaf: leaf[objects] if leaf.ndim else leaf, results)


def _turned(moments: Sequence[Moment]) -> list[dict[str, Measure]]:
    angle, shift = 0.7, np.array([300.0, -200.0, 50.0])
    other = bank_of([exact(turned(s, angle, shift)) for s in scenarios("generated")])

    def moved(motion: Motion) -> Motion:
        yaw = np.asarray(motion.yaw) + angle
        return filled(
            motion.replace(
                xyz=rotate(np.asarray(motion.xyz), angle),
                yaw=(yaw + np.pi) % (2 * np.pi) - np.pi,
                velocity=rotate(np.asarray(motion.velocity), angle),
            ),
            0.0,
        )

    return [
        measure(
            m.replace(
                scene=m.scene.replace(bank=other),
                **_motions(m, moved),
            )
        )
        for m in moments
    ]


def _permuted(moments: Sequence[Moment]) -> list[dict[str, Measure]]:
    num_objects = len(moments[0].after.valid)
    order = np.append(0, 1 + np.random.default_rng(0).permutation(num_objects - 1))
    back = np.argsort(order)

    def shuffle(tree):
        return jax.tree.map(lambda leaf: leaf[order], tree)

    results = [
        measure(
            m.replace(
                object_size=shuffle(m.object_size),
                **_motions(m, shuffle),
            )
        )
        for m in moments
    ]
    return _taken(results, back)


def _padded(moments: Sequence[Moment]) -> list[dict[str, Measure]]:
    """Adds empty slots of everything, and writes numbers into all that is absent."""
    packed = [exact(s) for s in scenarios("generated")]
    sizes = Sizes.of(packed, MAX_OBJECTS)
    larger = {f.name: getattr(sizes, f.name) + 3 for f in dataclasses.fields(sizes)}
    other = jax.device_put(banks.build(packed, Sizes(**larger)))

    def padded(motion: Motion) -> Motion:
        pads = jax.tree.map(
            lambda leaf: jnp.pad(leaf, [(0, 3), *[(0, 0)] * (leaf.ndim - 1)]), motion
        )
        return filled(pads, 3.0)

    results = [
        measure(
            m.replace(
                scene=m.scene.replace(bank=other),
                object_size=jnp.pad(m.object_size, [(0, 3), (0, 0)], constant_values=9),
                **_motions(m, padded),
            )
        )
        for m in moments
    ]
    return _taken(results, np.arange(sizes.num_objects))


def _batched(moments: Sequence[Moment]) -> list[dict[str, Measure]]:
    bank = moments[0].scene.bank
    bare = [m.replace(scene=m.scene.index) for m in moments]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *bare)

    @jax.jit
    def measure_batch(bank: Bank, batch: Moment) -> dict[str, Measure]:
        def one(m):
            return measure_all(m.replace(scene=Scene(bank=bank, index=m.scene)))

        return jax.vmap(one)(batch)

    results = measure_batch(bank, stacked)
    return [jax.tree.map(lambda leaf, i=i: leaf[i], results) for i in range(len(bare))]


CHANGES = {
    "turned": _turned,
    "permuted": _permuted,
    "padded": _padded,
    "batched": _batched,
}


@functools.cache
def changed(change: str) -> list[dict[str, Measure]]:
    """Returns the measures of the generated samples after a change of no import."""
    return CHANGES[change]([sample.moment for sample in samples("generated")])


def assert_kept(change: str, name: str, tolerance: float) -> None:
    """Asserts that a change of no import leaves a metric as it was."""
    for sample, after in zip(samples("generated"), changed(change), strict=True):
        before = sample.measures[name]
        np.testing.assert_array_equal(after[name].valid, before.valid)
        valid = np.asarray(before.valid)
        difference = np.asarray(after[name].value - before.value)[valid]
        np.testing.assert_allclose(difference, 0, atol=tolerance)
