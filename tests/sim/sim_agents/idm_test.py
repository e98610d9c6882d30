"""Tests the intelligent driver against the oracle, over whole episodes."""

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Int

from drivetrain.sim.data.synthetic import generate as synthetic
from drivetrain.sim.data.synthetic.generate import SyntheticConfig
from drivetrain.sim.motion import Motion
from drivetrain.sim.scenario import Scenario
from drivetrain.sim.scene import Scene
from drivetrain.sim.sim_agents import build
from drivetrain.sim.sim_agents.idm import IdmConfig, idm
from tests import worlds
from tests.oracles import idm as oracle

NUM_STEPS = 80
NUM_OBJECTS = 8  # the oracle's loops take seconds for more
# Errors of float32 in a gap grow while a queue settles; 80 steps of 0.1 s leave
# centimetres where a box only just meets the swept way at one step.
STOPS = (1, 4)  # an arrow, and a plain light
ROUNDING = 0.02  # metres
# The model creeps up to its least gap, 2 m: slower than 0.5 m/s in the last metre.
LIT_SEEDS = (1, 7, 23)  # of junctions where lights stay red
LARGEST_WAITING_GAP = 3.0  # metres
SPEED_ROUNDING = 0.05  # metres per second


lights_at = jax.jit(Scene.lights_at)


@functools.partial(jax.jit, static_argnames="name")
def play(scene: Scene, name: str) -> Motion:
    """Lets a sim agent drive everybody."""
    agent = build.build(name)

    def step(carry, number: Int[Array, ""]):
        memory, motion = agent.step(scene, *carry, number)
        return (memory, motion), motion

    start = scene.current_step
    first = agent.reset(scene), scene.log_at(start)
    _, motion = jax.lax.scan(step, first, start + jnp.arange(NUM_STEPS))
    return motion


def log_of(scenario: Scenario, num_objects: int) -> oracle.Log:
    """Returns the log for the oracle, in the order and frame of the bank."""
    tracks = scenario.tracks
    order = worlds.order_of(scenario, num_objects)
    return oracle.Log(
        xyz=tracks.xyz[order] - scenario.origin,
        yaw=tracks.yaw[order],
        velocity=tracks.velocity[order],
        valid=tracks.valid[order],
        size=tracks.size[order],
        object_type=tracks.object_type[order],
    )


def world_of(log: oracle.Log, step: int) -> oracle.World:
    """Returns the world as logged."""
    return oracle.World(
        log.xyz[:, step, :2],
        log.yaw[:, step],
        log.velocity[:, step],
        log.valid[:, step],
    )


def lights_of(scene: Scene, step: int) -> list[oracle.Light]:
    """Returns the lights whose lane is known."""
    lights = lights_at(scene, jnp.int32(step))
    return [
        oracle.Light(np.float64(xyz[:2]), float(yaw), int(state) in STOPS)
        for xyz, yaw, state, has_lane in zip(
            lights.xyz, lights.yaw, lights.state, lights.has_lane, strict=True
        )
        if has_lane
    ]


def play_oracle(
    log: oracle.Log, start: int, scene: Scene | None = None
) -> list[oracle.World]:
    """Lets the oracle drive everybody, stopping at the lights of a scene."""
    agents = oracle.IdmOracle(log, start, oracle.Params())
    worlds_after = []
    now = world_of(log, start)
    for step in range(start, start + NUM_STEPS):
        lights = lights_of(scene, step) if scene else ()
        target, logged = agents.step(now, lights), world_of(log, step + 1)
        driven = agents.driven
        now = oracle.World(
            np.where(driven[:, None], target.xy, logged.xy),
            np.where(driven, target.yaw, logged.yaw),
            np.where(driven[:, None], target.velocity, logged.velocity),
            logged.valid | driven,
        )
        worlds_after.append(now)
    return worlds_after


@functools.cache
def few(kind: str) -> tuple[Scenario, ...]:
    """Returns scenarios in which somebody is in somebody's way."""
    if kind == "real":
        return worlds.scenarios("real")[1:]
    config = SyntheticConfig(max_others=12)
    return tuple(synthetic.generate(seed, config) for seed in range(3))


@pytest.mark.parametrize("name", ["idm", "idm_lights"])
@pytest.mark.parametrize("kind", worlds.KINDS)
def test_episodes_are_those_of_the_oracle(kind: str, name: str) -> None:
    scenarios = few(kind)
    bank = worlds.bank_of([worlds.exact(s) for s in scenarios], NUM_OBJECTS)
    num_driven = 0
    for index, scenario in enumerate(scenarios):
        log = log_of(scenario, NUM_OBJECTS)
        scene = worlds.scene(bank, index)
        played = play(scene, name)
        expected = play_oracle(
            log, scenario.current_step, scene if name == "idm_lights" else None
        )
        agents = oracle.IdmOracle(log, scenario.current_step, oracle.Params())
        num_driven += agents.driven.sum()
        for step, world in enumerate(expected):
            here = world.valid
            ours = jax.tree.map(operator.itemgetter((step, slice(len(here)))), played)
            np.testing.assert_array_equal(ours.valid, here)
            np.testing.assert_allclose(
                ours.xy[here], world.xy[here], rtol=0, atol=ROUNDING
            )
            np.testing.assert_allclose(
                ours.velocity[here], world.velocity[here], rtol=0, atol=SPEED_ROUNDING
            )
    assert num_driven > 3  # else the samples prove nothing


def test_a_red_light_is_waited_at() -> None:
    config = SyntheticConfig(kinds=("junction",), max_others=12)
    scenarios = [synthetic.generate(seed, config) for seed in LIT_SEEDS]
    bank = worlds.bank_of([worlds.exact(s) for s in scenarios], NUM_OBJECTS)
    num_waiting = 0
    for index in range(len(scenarios)):
        scene = worlds.scene(bank, index)
        last = scene.current_step + NUM_STEPS
        free, held = (
            jax.tree.map(operator.itemgetter(-1), play(scene, name))
            for name in ("idm", "idm_lights")
        )
        stops = np.array([light.xy for light in lights_of(scene, last) if light.is_red])
        heading = np.stack([np.cos(held.yaw), np.sin(held.yaw)], axis=-1)
        half = 0.5 * np.asarray(scene.object_size)[:, :1]
        front = np.asarray(held.xy) + half * heading
        ahead = np.linalg.norm(front[:, None] - stops[None], axis=-1).min(axis=1)
        is_late = np.linalg.norm(free.xy - held.xy, axis=-1) > 10.0
        waits = is_late & (np.asarray(held.speed) < 0.5) & (ahead < LARGEST_WAITING_GAP)
        # Who stood nearer to the line when it took over stays there.
        start = log_of(scenarios[index], NUM_OBJECTS).xyz[:, scene.current_step, :2]
        came = np.linalg.norm(np.asarray(held.xy)[: len(start)] - start, axis=-1) > 5.0
        waits = waits[: len(start)] & came
        assert np.all(ahead[: len(start)][waits] > IdmConfig().min_gap)
        num_waiting += waits.sum()
    assert num_waiting > 0


@pytest.mark.parametrize(
    ("name", "value"), [("desired_speed", 0.0), ("num_chords", 0), ("min_gap", -1.0)]
)
def test_a_wrong_parameter_is_told(name: str, value: float) -> None:
    sentence = f"{name} of the IDM must be positive, got {value}"
    with pytest.raises(ValueError, match=sentence):
        IdmConfig(**{name: value})


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_who_is_driven_is_told_by_the_oracle(kind: str) -> None:
    reset = jax.jit(idm(IdmConfig()).reset)
    for index, scenario in enumerate(worlds.scenarios(kind)):
        log = log_of(scenario, worlds.MAX_OBJECTS)
        agents = oracle.IdmOracle(log, scenario.current_step, oracle.Params())
        driven = np.asarray(reset(worlds.scene(worlds.bank(kind), index)).is_driven)
        np.testing.assert_array_equal(driven[: len(agents.driven)], agents.driven)
        assert not driven[len(agents.driven) :].any()


def test_nobody_backs_and_all_is_finite() -> None:
    for index in range(len(worlds.SEEDS)):
        played = play(worlds.scene(worlds.bank("generated"), index), "idm")
        for leaf in jax.tree.leaves(played):
            assert np.isfinite(leaf).all()
        driven = np.asarray(
            idm(IdmConfig())
            .reset(worlds.scene(worlds.bank("generated"), index))
            .is_driven
        )
        along = (
            played.velocity[..., 0] * jnp.cos(played.yaw)
            + played.velocity[..., 1] * jnp.sin(played.yaw)
        )[:, driven]
        assert (along >= -1e-6).all()


def test_a_batch_is_a_loop() -> None:
    bank = worlds.bank("generated")
    numbers = jnp.arange(3)
    batch = jax.vmap(lambda i: play(Scene(bank=bank, index=i), "idm").xyz)(numbers)
    for index in range(3):
        alone = play(worlds.scene(bank, index), "idm").xyz
        np.testing.assert_allclose(batch[index], alone, rtol=0, atol=ROUNDING)


def test_a_wrong_name_is_told_with_its_cure() -> None:
    with pytest.raises(ValueError, match=r"'idn'; did you mean 'idm'\? Known"):
        build.build("idn")
