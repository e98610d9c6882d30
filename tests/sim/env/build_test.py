"""Tests that configs become tasks, and that wrong ones are named."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.dynamics import build as dynamics
from drivetrain.sim.env import build
from drivetrain.sim.env.build import PlanningConfig, SelfPlayConfig, ShapingConfig
from drivetrain.sim.observations.vector import vector
from drivetrain.sim.rewards import SPARSE
from drivetrain.sim.scene import Scene
from tests import worlds
from tests.sim.env.planning_test import SMALL

ROUNDING = 1e-6  # float32 sums of two numbers
SHAPING_ROUNDING = 1e-5  # float32 differences of places of some 100 m


def stepped(config: build.TaskConfig, jump: float):
    """Returns a step of a task in which the actors go so far aside."""
    env = build.build(config, dynamics.build("delta"), vector(SMALL))
    bank = worlds.bank("generated")
    state = env.reset(bank, jnp.int32(0), jax.random.key(0))
    action = jnp.array([0.0, jump, 0.0])
    if isinstance(env.action_spec, tuple):
        action = (jnp.broadcast_to(action, (len(state.admitted), 3)),)
    return jax.jit(env.step)(bank, state, action)


@pytest.mark.parametrize("reward", ["sparse", dict(SPARSE)])
def test_a_preset_and_its_weights_are_the_same_reward(reward) -> None:
    _, timestep = stepped(PlanningConfig(reward=reward), 900.0)
    assert timestep.measures["offroad"].value == 1
    assert timestep.reward == -1 - timestep.measures["collision"].value


@pytest.mark.parametrize("settled_at", [(), ("collision",), ("collision", "offroad")])
def test_what_settles_the_past_has_no_discount_and_ends_nothing(settled_at) -> None:
    _, timestep = stepped(PlanningConfig(settled_at=settled_at), 900.0)
    assert timestep.measures["offroad"].value == 1
    assert timestep.measures["collision"].value == 0
    assert timestep.discount == ("offroad" not in settled_at)
    assert not timestep.terminated
    _, on_road = stepped(PlanningConfig(settled_at=settled_at), 0.0)
    assert on_road.discount == 1


def test_shaping_takes_all_back_where_the_past_is_settled() -> None:
    shaping = ShapingConfig(towards="log", weight=0.5, discount=0.9)
    config = PlanningConfig(settled_at=("offroad",), shaping=shaping)
    _, plain = stepped(PlanningConfig(), 900.0)
    _, shaped = stepped(config, 900.0)
    # It starts where the log is: there is nothing to take back, nor to pay for.
    np.testing.assert_allclose(shaped.reward, plain.reward, atol=1e-3)
    config = PlanningConfig(settled_at=("collision",), shaping=shaping)
    assert stepped(config, 900.0)[1].reward < plain.reward - 0.5 * 0.9 * 800


def test_smooth_costs_are_measured_where_a_reward_asks_for_them() -> None:
    weights = {"smooth_offroad": -0.5, "log_displacement": -1.0}
    _, timestep = stepped(PlanningConfig(reward=weights), 20.0)
    expected = sum(w * timestep.measures[name].value for name, w in weights.items())
    np.testing.assert_allclose(timestep.reward, expected, rtol=ROUNDING)
    assert timestep.measures["smooth_offroad"].value > 0
    _, plain = stepped(PlanningConfig(), 20.0)
    assert "smooth_offroad" not in plain.measures


@pytest.mark.parametrize("towards", ["goal", "log"])
def test_shaping_takes_back_what_going_away_costs(towards) -> None:
    shaping = ShapingConfig(towards=towards, weight=0.5, discount=1.0)
    _, plain = stepped(PlanningConfig(), 90.0)
    state, shaped = stepped(PlanningConfig(shaping=shaping), 90.0)
    # The first place is the log's own, at the time.
    scene = Scene(bank=worlds.bank("generated"), index=state.index)
    start, there = scene.log_at(state.step - 1).xy[0], scene.log_at(state.step).xy[0]
    place = scene.log_end().xy[0] if towards == "goal" else there
    gained = np.linalg.norm(start - place) if towards == "goal" else 0.0
    gained -= np.linalg.norm(state.motion.xy[0] - place)
    added = shaped.reward - plain.reward
    np.testing.assert_allclose(added, 0.5 * gained, rtol=SHAPING_ROUNDING)


def test_in_self_play_those_who_move_act_and_leave_when_they_are_hit() -> None:
    config = SelfPlayConfig(remove_at=("offroad",))
    state, timestep = stepped(config, 900.0)
    assert timestep.acted.any() and not timestep.acted.all()
    np.testing.assert_array_equal(
        timestep.terminated[timestep.acted], timestep.discount[timestep.acted] == 0
    )
    assert timestep.terminated[timestep.acted].all()
    assert not state.motion.valid[timestep.acted].any()


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        (PlanningConfig, {"sim_agent": "idmm"}, "did you mean 'idm'"),
        (PlanningConfig, {"reward": "sparce"}, "did you mean 'sparse'"),
        (PlanningConfig, {"reward": {"offrod": 1.0}}, "did you mean 'offroad'"),
        (PlanningConfig, {"settled_at": ("colision",)}, "did you mean 'collision'"),
        (SelfPlayConfig, {"remove_at": ("goals",)}, "did you mean 'goal'"),
        (SelfPlayConfig, {"shaping": ShapingConfig(weight=-1.0)}, "must be positive"),
    ],
)
def test_what_does_not_fit_is_refused(kind: type, fields: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        kind(**fields)
