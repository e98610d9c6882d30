"""Tests that plans are followed to the pose, and made anew when they are done."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents import build, plan
from drivetrain.agents.build import AgentConfig
from drivetrain.agents.encoders.flat import FlatConfig
from drivetrain.agents.encoders.wayformer import WayformerConfig
from drivetrain.agents.heads.trajectory import TrajectoryConfig
from drivetrain.agents.planner import PlannerConfig
from drivetrain.sim.dynamics.base import Discrete
from drivetrain.sim.dynamics.delta import delta
from drivetrain.sim.motion import Motion
from drivetrain.sim.observations.base import TokenGroup

# Five sums and turns in float32 of places up to 100 m, which step by 8e-6 m.
ROUNDING = 1e-4
SMALL = AgentConfig(
    encoder=WayformerConfig(width=8, num_heads=2, num_layers=1, num_latents=2),
    trajectory=TrajectoryConfig(num_modes=6, num_steps=7, num_heads=2),
)


def seen(value: float) -> dict[str, TokenGroup]:
    values = jnp.full((1, 1, 4), value).at[0, 0, 0].set(1.0)
    return {"ego": TokenGroup(values=values, mask=jnp.ones((1, 1), bool))}


def test_delta_dynamics_land_on_the_poses_of_the_plan() -> None:
    random = np.random.default_rng(0)
    poses = random.normal(size=(5, 3)) * [3, 3, 2]
    here = Motion(
        xyz=jnp.array([40.0, -90.0, 1.0]),
        yaw=jnp.array(2.5),
        velocity=jnp.zeros(2),
        valid=jnp.bool_(True),
    )
    following = plan.along(jnp.asarray(poses, jnp.float32))
    motion, dynamics = here, delta("local")
    for x, y, turn in poses:
        following, action = following.follow()
        motion = dynamics.forward(motion, jnp.ones(3), action, 0.1)
        cos, sin = np.cos(2.5), np.sin(2.5)
        expected = [40 + cos * x - sin * y, -90 + sin * x + cos * y]
        np.testing.assert_allclose(motion.xy, expected, atol=ROUNDING)
        off = (float(motion.yaw) - 2.5 - turn + np.pi) % (2 * np.pi) - np.pi
        assert abs(off) < ROUNDING
    assert following.is_done()


def test_the_agent_looks_once_a_plan() -> None:
    agent = build.build(SMALL, seen(0.0), plan.ACTION_SPEC, "trajectories")
    params, step = agent.init(jax.random.key(0)), jax.jit(agent.step)
    memory, taken, fresh = agent.memory(), [], []
    for number in range(12):
        observation = seen(float(number))
        memory, output = step(params, memory, observation)
        taken.append(output.policy.mode())
        assert (output.policy.sample(jax.random.key(1)) == taken[-1]).all()
        if number % 5 == 0:
            whole, first = step(params, agent.memory(), observation)
            assert (first.policy.action == whole.actions[0]).all()
            fresh.append(whole.actions)
    assert not np.array_equal(fresh[0], fresh[1])
    np.testing.assert_array_equal(np.stack(taken), np.concatenate(fresh)[:12])


@pytest.mark.parametrize(
    ("fields", "spec", "message"),
    [
        ({}, Discrete(5), "dynamics=delta"),
        ({}, delta("global").action_spec, "dynamics=delta"),
        ({"encoder": FlatConfig(widths=(8,))}, plan.ACTION_SPEC, "wayformer"),
        ({"memory_width": 3}, plan.ACTION_SPEC, "memory_width=0, got 3"),
    ],
)
def test_parts_that_do_not_fit_are_refused(fields, spec, message: str) -> None:
    config = AgentConfig(**fields)
    with pytest.raises(ValueError, match=message):
        build.build(config, seen(0.0), spec, "trajectories")


def test_a_plan_longer_than_the_forecast_is_refused() -> None:
    with pytest.raises(ValueError, match=r"planner.num_steps must be .* got 9 and 7"):
        AgentConfig(trajectory=SMALL.trajectory, planner=PlannerConfig(num_steps=9))
