"""Looks at packed scenarios through scenes, beside what they were packed from."""

import dataclasses
import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from drivetrain.sim.data import bank
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.motion import Motion
from drivetrain.sim.scenario import Polylines, Scenario
from drivetrain.sim.scene import Scene
from drivetrain.sim.scene_records import Lights, PathSegments, Segments
from tests.oracles import geometry

POSITION = 0.01  # metres: half a quantum along each axis, and float32
YAW = np.radians(0.1)
SPEED = 0.01  # metres per second
SHAPE = 0.03 + 0.01  # metres: what simplification may move, and quantisation
FLOAT32 = 1e-4  # metres: the step of float32 at 1 km is 6e-5
LENGTH = 0.01  # share of a path's length that simplification may take
MAX_OBJECTS = 256


@dataclasses.dataclass(frozen=True)
class View:
    """A source, its packed form, and what a scene shows of that."""

    source: Scenario
    packed: Packed
    log: Motion  # [steps, objects]
    lights: Lights  # [steps, lights]
    segments: Segments
    paths: PathSegments

    @functools.cached_property
    def order(self) -> np.ndarray:
        """The place in the source of each packed object."""
        places = {int(n): i for i, n in enumerate(self.source.tracks.object_id)}
        return np.array([places[int(number)] for number in self.packed.object_id])


@jax.jit
def shown(banked: bank.Bank, index: jax.Array):
    """Returns all that a scene shows, at every step of the bank."""
    scene = Scene(bank=banked, index=index)
    steps = jnp.arange(banked.sizes.num_steps)
    log, lights = jax.vmap(scene.log_at)(steps), jax.vmap(scene.lights_at)(steps)
    return log, lights, scene.map_segments(), scene.path_segments()


def views(scenarios: list[Scenario], config: PackConfig) -> list[View]:
    """Packs scenarios into one bank and looks at each."""
    packed = [pack(scenario, config) for scenario in scenarios]
    banked = bank.build(packed, bank.Sizes.of(packed, MAX_OBJECTS))
    return [
        View(source, one, *jax.tree.map(np.asarray, shown(banked, jnp.int32(i))))
        for i, (source, one) in enumerate(zip(scenarios, packed, strict=True))
    ]


def in_scene(view: View, xyz: np.ndarray) -> np.ndarray:
    """Moves places of the file into the scenario's frame."""
    return xyz - view.source.tracks.xyz[view.source.ego_index, view.source.current_step]


def distance(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Returns the distance of each point to the nearest of the segments."""

    def nearest(point: np.ndarray) -> float:
        _, foot = geometry.feet(point, start, end)
        return np.linalg.norm(point - foot, axis=1).min()

    return np.array([nearest(point) for point in points])


def source_segments(roads: Polylines, kinds: tuple) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the pieces of the source's features of some kinds start and end."""
    runs = [
        roads.points_of(i)[[0, *range(n)]]  # a sign is a piece of no length
        for i, n in enumerate(np.diff(roads.offset))
        if roads.map_type[i] in kinds
    ]
    return (
        np.concatenate([run[:-1] for run in runs]),
        np.concatenate([run[1:] for run in runs]),
    )


def logged(view: View) -> Iterator[tuple[np.ndarray, ...]]:
    """Yields what the scene and the source say wherever the source is valid."""
    tracks, valid = view.source.tracks, view.source.tracks.valid[view.order]
    for name, wanted in (
        ("xyz", in_scene(view, tracks.xyz)),
        ("yaw", tracks.yaw),
        ("velocity", tracks.velocity),
    ):
        found = getattr(view.log, name)[: view.source.num_steps, : len(view.order)]
        found = np.swapaxes(found, 0, 1)
        yield found[valid], wanted[view.order][valid]
