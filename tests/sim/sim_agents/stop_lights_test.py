"""Tests which red lights hold an object back, by numbers worked by hand."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import pytest

from drivetrain.sim.scenario import LightState
from drivetrain.sim.scene_records import Lights
from drivetrain.sim.sim_agents import stop_lights
from drivetrain.sim.sim_agents.stop_lights import LightConfig

ROUNDING = 1e-5  # metres; float32 at 50 m
CHORD = 5.0  # metres
FRONT = 2.25  # metres
STRAIGHT = [(CHORD * i, 0.0) for i in range(11)]
# East for 20 m, then north.
CORNER = [(min(CHORD * i, 20.0), max(CHORD * i - 20.0, 0.0)) for i in range(11)]
measure = jax.jit(stop_lights.gap, static_argnums=(0, 3))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Light:
    """One light, 22 m ahead if not told otherwise."""

    x: float = 22.0
    y: float = 0.0
    yaw: float = 0.0
    state: LightState = LightState.STOP
    has_lane: bool = True


def gap(*lights: Light, way=STRAIGHT, speed: float = 10.0) -> float:
    """Returns the gap of an object that is at the start of a way."""
    record = Lights(
        xyz=jnp.array([(light.x, light.y, 0.0) for light in lights]),
        state=jnp.array([int(light.state) for light in lights]),
        yaw=jnp.array([light.yaw for light in lights]),
        has_lane=jnp.array([light.has_lane for light in lights]),
        valid=jnp.ones(len(lights), bool),
    )
    place = jnp.array(way)
    return float(
        measure(
            LightConfig(), record, place, CHORD, jnp.float32(FRONT), jnp.float32(speed)
        )
    )


@pytest.mark.parametrize(
    ("light", "way", "expected"),
    [
        (Light(), STRAIGHT, 19.75),
        (Light(state=LightState.ARROW_STOP), STRAIGHT, 19.75),
        (Light(y=-1.9, yaw=0.7), STRAIGHT, 19.75),
        # Within 2 m of the end of the chord before, but 0.5 m after it.
        (Light(x=20.5), STRAIGHT, 18.25),
        (Light(x=20.0, y=7.0, yaw=math.pi / 2), CORNER, 24.75),
    ],
)
def test_the_gap_reaches_from_the_front_to_the_stop_point(
    light: Light, way: list, expected: float
) -> None:
    assert gap(light, way=way) == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize(
    "light",
    [
        Light(state=LightState.GO),
        Light(state=LightState.CAUTION),
        Light(state=LightState.ARROW_GO),
        Light(state=LightState.UNKNOWN),
        Light(state=LightState.FLASHING_STOP),
        Light(y=2.1),
        Light(yaw=0.8),
        Light(yaw=math.pi),
        Light(has_lane=False),
        Light(x=2.2),
        Light(x=-4.0),
        Light(x=52.1),
    ],
    ids=str,
)
def test_other_lights_concern_nobody(light: Light) -> None:
    assert math.isinf(gap(light, speed=0.0))


def test_the_first_of_several_lights_counts() -> None:
    lights = Light(x=40.0), Light(x=30.0), Light(x=20.0, state=LightState.GO)
    assert gap(*lights) == pytest.approx(27.75, abs=ROUNDING)


def test_a_light_that_takes_too_hard_a_stop_is_passed() -> None:
    # 19.75 m at 6 m/s^2 are enough from sqrt(2 * 6 * 19.75) = 15.39 m/s.
    assert gap(Light(), speed=15.3) == pytest.approx(19.75, abs=ROUNDING)
    assert math.isinf(gap(Light(), speed=15.5))


def test_a_way_that_stands_leads_nowhere() -> None:
    assert math.isinf(gap(Light(x=0.0), way=[(0.0, 0.0)] * 11))


@pytest.mark.parametrize("name", ["distance", "turn", "max_deceleration"])
def test_a_wrong_limit_is_told(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} of lights must be positive, got 0"):
        LightConfig(**{name: 0.0})
