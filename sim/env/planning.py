"""Plays a scenario with the ego under control (W 4.3)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

from ..data.bank import Bank
from ..dynamics.base import Action, Dynamics
from ..goals import logged_goal
from ..metrics.base import Moment
from ..metrics.build import EGO, measure_ego
from ..motion import Motion
from ..observations.base import Observation, Observer, View
from ..rewards import Reward
from ..scene import Scene
from ..sim_agents.base import SimAgent
from .base import Environment, State, Timestep


def planning(
    dynamics: Dynamics,
    sim_agent: SimAgent,
    observer: Observer,
    reward: Reward,
) -> Environment:
    """Builds the environment.

    Args:
        dynamics: of the ego.
        sim_agent: drives all others.
        observer: what the ego sees.
        reward: of the state after the action.
    """
    history = observer.history

    def reset(bank: Bank, index: Int[Array, ""], key: PRNGKeyArray) -> State:
        scene = Scene(bank=bank, index=index)
        step = scene.current_step
        motion = scene.log_at(step)
        coasting = dynamics.controls(dynamics.coast(motion, bank.dt))
        past = jax.vmap(scene.log_at)(step - history + jnp.arange(history))
        return State(
            index=index,
            step=step,
            motion=motion,
            history=past,
            object_size=scene.object_size,
            sim_agent=sim_agent.reset(scene),
            goal=logged_goal(scene, motion),
            controls=jnp.where(motion.valid[:, None], coasting, 0.0),
            key=key,
        )

    def step(bank: Bank, state: State, action: Action) -> tuple[State, Timestep]:
        scene = Scene(bank=bank, index=state.index)
        logged = scene.log_at(state.step + 1)
        carry, others = sim_agent.step(scene, state.sim_agent, state.motion, state.step)
        before, size = object_of(state.motion, EGO), state.object_size[EGO]
        ego = dynamics.forward(before, size, action, bank.dt)
        moved = jax.tree.map(lambda all_, one: all_.at[EGO].set(one), others, ego)
        motion = _on_the_ground(moved, state.motion, logged)
        moment = Moment(
            scene=scene,
            object_size=state.object_size,
            step=state.step + 1,
            before=state.motion,
            after=motion,
            logged=logged,
            goal=state.goal,
        )
        measures = measure_ego(moment)
        following = state.replace(
            step=state.step + 1,
            motion=motion,
            history=_shift(state.history, state.motion),
            sim_agent=carry,
            controls=state.controls.at[EGO].set(dynamics.controls(action)),
            key=jax.random.fold_in(state.key, 0),
        )
        timestep = Timestep(
            reward=reward(moment, jnp.int32(EGO), measures),
            discount=jnp.float32(1.0),
            terminated=jnp.bool_(False),
            truncated=following.step + 1 >= scene.num_steps,
            measures=measures,
        )
        return following, timestep

    def observe_state(bank: Bank, state: State) -> Observation:
        scene = Scene(bank=bank, index=state.index)
        seen = jax.tree.map(
            lambda past, now: jnp.concatenate([past, now[None]]),
            state.history,
            state.motion,
        )
        view = View(
            scene=scene,
            step=state.step,
            motion=seen,
            object_size=state.object_size,
            goal=state.goal,
            controls=state.controls,
            key=state.key,
        )
        return observer.observe(view, jnp.int32(EGO))

    return Environment(dynamics.action_spec, reset, step, observe_state)


def object_of(motion: Motion, number: int) -> Motion:
    """Returns the motion of one object, without the axis of objects."""
    return jax.tree.map(lambda leaf: leaf[number], motion)


def _on_the_ground(moved: Motion, before: Motion, logged: Motion) -> Motion:
    """Takes heights from the log, and keeps the last ones where it has none."""
    height = jnp.where(logged.valid, logged.xyz[:, 2], before.xyz[:, 2])
    height = jnp.where(moved.valid, height, 0.0)
    return moved.replace(xyz=moved.xyz.at[:, 2].set(height))


def _shift(history: Motion, motion: Motion) -> Motion:
    """Appends the present step to the history and forgets the oldest."""
    return jax.tree.map(
        lambda past, now: jnp.concatenate([past, now[None]])[1:], history, motion
    )
