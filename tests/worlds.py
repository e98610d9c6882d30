"""Makes small worlds for the tests: banks of scenarios, and motions off the log."""

import dataclasses
import functools
import pathlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int

from drivetrain.sim.data import bank as banks, build as readers, routes
from drivetrain.sim.data.bank import Bank, Sizes
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import Packed
from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.goals import logged_goal
from drivetrain.sim.metrics.base import Measure, Moment
from drivetrain.sim.metrics.build import measure_all
from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.base import View
from drivetrain.sim.scenario import EDGES, Polylines, Scenario
from drivetrain.sim.scene import Scene

REAL_DATA = pathlib.Path(__file__).resolve().parents[2] / "shared/data"
REAL_FILES = (
    "womd/motion_data_one_example.tfrecord",
    "womd/motion_data_one_scenario.tfrecord",
    "womd_json/tfrecord-00001-of-01000_307.json.gz",
    "womd_json/tfrecord-00004-of-01000_157.json.gz",
)
KINDS = ("generated", "real")
MOTIONS = ("before", "after", "logged")  # of a moment
SEEDS = (45, 16, 4, 14, 3, 15)  # of generated scenarios: with lights and without
MAX_OBJECTS = 16
PLAYED = slice(10, 36)  # steps
NUM_VARIED = 15  # objects of generated scenarios, so that all fit

# At 1 km from the ego float32 steps by 0.06 mm; a dozen errors make less than this [m].
ROUNDING = 1e-3
NUDGES = ROUNDING * np.array([(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)])


class Sample(NamedTuple):
    """One step of one scenario, and what is measured of it."""

    scenario: Scenario
    moment: Moment
    measures: dict[str, Measure]  # of all objects, or of the ego


@functools.cache
def exact(scenario: Scenario) -> Packed:
    """Packs a scenario in float32, with every point of its map."""
    return pack(scenario, PackConfig(quantize=False))


def bank_of(packed: Sequence[Packed], max_objects: int = MAX_OBJECTS) -> Bank:
    """Builds a bank on the device."""
    return jax.device_put(banks.build(packed, Sizes.of(packed, max_objects)))


def varied(scenario: Scenario) -> Scenario:
    """Keeps a few objects: by turns the nearest of each type and those that stand.

    Nearest is meant in the steps that tests play.
    """
    tracks, ego = scenario.tracks, scenario.ego_index
    gap = np.linalg.norm(tracks.xyz - tracks.xyz[ego], axis=-1)
    gap = np.where(tracks.valid, gap, np.inf)[:, PLAYED].min(axis=1)
    logs = zip(tracks.xyz, tracks.valid, strict=True)
    moves = [np.ptp(xyz[valid], axis=0).max() > 1 for xyz, valid in logs]
    kind = np.where(moves, tracks.object_type, 0)
    turn = np.where(np.isinf(gap), len(gap), 0)
    for own in np.unique(kind):
        members = np.flatnonzero(kind == own)
        nearest = members[np.argsort(gap[members], kind="stable")]
        turn[nearest] += np.arange(len(members))
    turn[ego] = -1
    kept = np.sort(np.argsort(turn, kind="stable")[:NUM_VARIED])
    fields = {name: values[kept] for name, values in vars(tracks).items()}
    return dataclasses.replace(
        scenario,
        tracks=dataclasses.replace(tracks, **fields),
        ego_index=int(np.searchsorted(kept, ego)),
    )


@functools.cache
def scenarios(kind: str) -> tuple[Scenario, ...]:
    """Returns generated scenarios or real ones, with paths; skips without files."""
    if kind == "generated":
        return tuple(varied(synthetic.generate(seed)) for seed in SEEDS)
    paths = [REAL_DATA / name for name in REAL_FILES]
    if not all(path.exists() for path in paths):
        pytest.skip("the real files of ../shared/data are not here")
    read = [next(iter(readers.read(path))) for path in paths]
    return tuple(routes.with_paths(s) for s in read if isinstance(s, Scenario))


@functools.cache
def bank(kind: str) -> Bank:
    """Returns the bank of the scenarios of a kind, unquantised."""
    return bank_of([exact(scenario) for scenario in scenarios(kind)])


def scene(bank: Bank, index: int) -> Scene:
    """Returns the view of one scenario."""
    return Scene(bank=bank, index=jnp.int32(index))


@jax.jit
def log_at(scene: Scene, step: Int[Array, ""]) -> Motion:
    """Returns the logged motion."""
    return scene.log_at(step)


def kicked(motion: Motion, seed: int) -> Motion:
    """Moves objects off the log: some stay, others move by centimetres or metres.

    But for the ego, a tenth vanishes, and a fifth goes where another object is.
    """
    rng = np.random.default_rng(seed)
    num_objects = len(motion.yaw)
    scale = rng.choice([0.0, 0.1, 1.0, 4.0], num_objects)
    shift = rng.normal(0, (1.5, 1.5, 0.2), (num_objects, 3)) * scale[:, None]
    turn = rng.normal(0, 0.3, num_objects) * scale
    push = rng.normal(0, 2.0, (num_objects, 2)) * scale[:, None]
    is_here = rng.random(num_objects) < 0.9
    is_here[0] = True
    valid = np.asarray(motion.valid) & is_here
    xyz = np.array(motion.xyz)
    crowded = (rng.random(num_objects) < 0.2) & (np.arange(num_objects) > 0)
    others = rng.choice(np.flatnonzero(valid), num_objects)
    xyz[crowded] = xyz[others[crowded]] + rng.normal(0, (2, 2, 0), (crowded.sum(), 3))
    moved = Motion(
        xyz=xyz + shift,
        yaw=(np.asarray(motion.yaw) + turn + np.pi) % (2 * np.pi) - np.pi,
        velocity=np.asarray(motion.velocity + push),
        valid=valid,
    )
    return filled(moved, 0.0)


def filled(motion: Motion, fill: float) -> Motion:
    """Writes a number into all that is not valid."""
    valid = jnp.asarray(motion.valid)

    def where_valid(leaf):
        mask = valid.reshape(-1, *[1] * (np.ndim(leaf) - 1))
        return jnp.where(mask, jnp.asarray(leaf, jnp.float32), fill)

    return jax.tree.map(where_valid, motion).replace(valid=valid)


def moment_of(scene: Scene, step: int, seed: int) -> Moment:
    """Returns a step of a scenario with everybody off the log."""
    logged = log_at(scene, jnp.int32(step))
    return Moment(
        scene=scene,
        object_size=scene.object_size,
        step=jnp.int32(step),
        before=kicked(log_at(scene, jnp.int32(step - 1)), 2 * seed),
        after=kicked(logged, 2 * seed + 1),
        logged=logged,
        goal=logged_goal(scene, log_at(scene, scene.current_step)),
    )


def car_size(motion: Motion) -> Float[Array, "*objects 3"]:
    """Returns the size of a car for each object."""
    return jnp.broadcast_to(jnp.array([4.5, 2.0, 1.6]), (*motion.yaw.shape, 3))


def view_of(scene: Scene, motion: Motion, step: int) -> View:
    """Returns what observers see: a history of motions and all that is constant."""
    start = log_at(scene, scene.current_step)
    return View(
        scene=scene,
        step=jnp.int32(step),
        motion=motion,
        object_size=scene.object_size,
        goal=logged_goal(scene, start),
        controls=jnp.zeros((len(start.valid), 2)),
        key=jax.random.key(0),
    )


measure = jax.jit(measure_all)


@functools.cache
def samples(kind: str) -> tuple[Sample, ...]:
    """Returns three steps of each scenario of a kind, measured."""
    made = []
    for index, scenario in enumerate(scenarios(kind)):
        for number, step in enumerate((scenario.current_step + 1, 40, 90)):
            moment = moment_of(scene(bank(kind), index), step, 100 * index + number)
            made.append(Sample(scenario, moment, measure(moment)))
    return tuple(made)


def kicked_pairs(kind: str) -> tuple[Motion, Motion]:
    """Returns motions before and after a step of all objects that have both."""
    moments = [sample.moment for sample in samples(kind)]
    both = np.concatenate([m.before.valid & m.after.valid for m in moments])

    def joined(motions: Iterable[Motion]) -> Motion:
        return jax.tree.map(
            lambda *leaves: jnp.asarray(np.concatenate(leaves)[both]), *motions
        )

    return joined(m.before for m in moments), joined(m.after for m in moments)


def order_of(scenario: Scenario, num_objects: int) -> Int[np.ndarray, " objects"]:
    """Returns which tracks the bank keeps, in its order."""
    number = {int(name): i for i, name in enumerate(scenario.tracks.object_id)}
    kept = exact(scenario).object_id[:num_objects]
    return np.array([number[int(name)] for name in kept])


def edges_of(scenario: Scenario) -> list[Float[np.ndarray, "points 3"]]:
    """Returns the road edges in the frame of the scenario."""
    roads = scenario.roads
    edges = np.flatnonzero(np.isin(roads.map_type, EDGES))
    return [roads.points_of(int(edge)) - scenario.origin for edge in edges]


def paths_of(scenario: Scenario) -> list[Float[np.ndarray, "points 2"]]:
    """Returns the ways of the ego in the frame of the scenario."""
    assert scenario.paths is not None
    count = range(len(scenario.paths.on_route))
    return [(scenario.paths.points_of(i) - scenario.origin)[:, :2] for i in count]


def with_edges(
    scenario: Scenario, edges: Sequence[Float[np.ndarray, "points 3"]]
) -> Scenario:
    """Returns the scenario with road edges in its own frame, and no other map."""
    lengths = [len(edge) for edge in edges]
    roads = Polylines(
        xyz=np.concatenate(edges) + scenario.origin,
        offset=np.cumsum([0, *lengths]),
        map_type=np.full(len(edges), EDGES[1]),
        feature_id=np.arange(len(edges)),
    )
    return dataclasses.replace(scenario, roads=roads)


def rotate(xy: np.ndarray, angle: float) -> np.ndarray:
    """Turns vectors in the plane; a third component stays."""
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.eye(xy.shape[-1])
    matrix[:2, :2] = (cos, -sin), (sin, cos)
    return np.float64(xy) @ matrix.T


def turned(scenario: Scenario, angle: float, shift: np.ndarray) -> Scenario:
    """Turns a scenario about the zero of its map, and then shifts it."""
    tracks, paths, roads = scenario.tracks, scenario.paths, scenario.roads
    assert paths is not None

    def moved(xyz):
        return rotate(xyz, angle) + shift

    return dataclasses.replace(
        scenario,
        tracks=dataclasses.replace(
            tracks,
            xyz=moved(tracks.xyz),
            yaw=tracks.yaw + angle,
            velocity=rotate(tracks.velocity, angle),
        ),
        roads=dataclasses.replace(roads, xyz=moved(roads.xyz)),
        lights=dataclasses.replace(scenario.lights, xyz=moved(scenario.lights.xyz)),
        paths=dataclasses.replace(paths, xyz=moved(paths.xyz)),
    )
