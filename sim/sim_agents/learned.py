"""Drives objects by a policy."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from .. import motions, pytrees
from ..dynamics.base import Action, Dynamics
from ..goals import Goal, logged_goal
from ..motion import Motion
from ..observations.base import View
from ..records import Record
from ..scene import Scene
from .base import SimAgent

# Of what there is to see, and the number of the object that acts.
Policy = Callable[[View, Int[Array, ""]], Action]
# The same of one who remembers: it also takes and returns what it remembers.
Rememberer = Callable[[Any, View, Int[Array, ""]], tuple[Any, Action]]


class Memory(Record):
    """What of an episode the present motion does not say."""

    history: Motion  # of the steps before, oldest first, with a leading axis
    goal: Goal
    controls: Float[Array, "objects features"]  # of the last actions; coasting at first
    own: Any  # what the policy of each object remembers


def learned(policy: Policy, dynamics: Dynamics, history: int = 0) -> SimAgent:
    """Builds the sim agent.

    Each object that is there acts by itself and stays, also where its log has ended;
    the others join when the log says. The key of a view depends on the scenario and the
    step alone, so that an episode is always played alike.

    Args:
        policy: what an object does; `observer.observe` of the view and the number is
            what it sees.
        dynamics: of its actions.
        history: how many steps before the present one a view holds.
    """

    def act(own: Any, view: View, number: Int[Array, ""]) -> tuple[Any, Action]:
        return own, policy(view, number)

    return remembering(act, (), dynamics, history)


def remembering(
    policy: Rememberer, memory: PyTree[Array], dynamics: Dynamics, history: int = 0
) -> SimAgent:
    """Builds the sim agent of a policy with memory; all else is as for `learned`.

    Args:
        policy: what an object does, and what it remembers of it.
        memory: what an object remembers before it is there.
        dynamics: of its actions.
        history: how many steps before the present one a view holds.
    """

    def reset(scene: Scene) -> Memory:
        start = scene.current_step
        motion = scene.log_at(start)
        held = dynamics.controls(dynamics.coast(motion, scene.bank.dt))
        return Memory(
            own=pytrees.spread(memory, len(motion.valid)),
            history=jax.vmap(scene.log_at)(start - history + jnp.arange(history)),
            goal=logged_goal(scene, motion),
            controls=jnp.where(motion.valid[:, None], held, 0.0),
        )

    def step(
        scene: Scene, carry: Memory, motion: Motion, step: Int[Array, ""]
    ) -> tuple[Memory, Motion]:
        seen = motions.append(carry.history, motion)
        key = jax.random.fold_in(jax.random.key(0), scene.index)
        view = View(
            scene=scene,
            step=step,
            motion=seen,
            object_size=scene.object_size,
            goal=carry.goal,
            controls=carry.controls,
            key=jax.random.fold_in(key, step),
        )
        numbers = jnp.arange(len(motion.valid))
        own, action = jax.vmap(policy, in_axes=(0, None, 0))(carry.own, view, numbers)
        moved = dynamics.forward(motion, view.object_size, action, scene.bank.dt)
        fresh = pytrees.spread(memory, len(numbers))
        carry = carry.replace(
            own=pytrees.where(motion.valid, own, fresh),
            history=jax.tree.map(lambda leaf: leaf[1:], seen),
            controls=dynamics.controls(action),
        )
        return carry, motions.where(motion.valid, moved, scene.log_at(step + 1))

    return SimAgent("learned", reset, step)
