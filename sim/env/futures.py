"""Shows where the log went on to: observations with the ego's path from there."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .. import geometry
from ..data.bank import Bank
from ..data.stratum import Stratum
from ..dynamics.base import Dynamics
from ..metrics.build import EGO
from ..motions import object_of
from ..observations.base import Observation, Observer
from ..records import Record
from .logged_views import logged_view


class Future(Record):
    """What the ego saw at one step, and its poses at the steps after it.

    A pose is (x, y, yaw): metres ahead, metres to the left and the turn since, as in a
    forecast of trajectories.
    """

    observation: Observation
    poses: Float[Array, "steps 3"]  # m, m, rad; zero where the mask is False
    mask: Bool[Array, " steps"]  # the ego was logged then, and when it looked


Sample = Callable[[Bank, Stratum, PRNGKeyArray], Future]


def futures(dynamics: Dynamics, observer: Observer, num_steps: int) -> Sample:
    """Builds the function that draws one future of a bank.

    Moments are drawn as for demonstrations, so near its end the log has fewer steps
    left than are wanted; those that it lacks are masked.
    """

    def sample(bank: Bank, stratum: Stratum, key: PRNGKeyArray) -> Future:
        view = logged_view(dynamics, observer, bank, stratum, key)
        here = object_of(jax.tree.map(lambda leaf: leaf[-1], view.motion), EGO)
        steps = view.step + 1 + jnp.arange(num_steps)
        ahead = jax.tree.map(
            lambda leaf: leaf.at[steps].get(mode="fill", fill_value=0),
            view.scene.log_of(jnp.int32(EGO)),
        )
        mask = ahead.valid & here.valid
        xy = geometry.to_frame(ahead.xy - here.xy[None], here.yaw)
        turn = geometry.wrap_angle(ahead.yaw - here.yaw)
        poses = jnp.concatenate([xy, turn[:, None]], axis=-1)
        return Future(
            observation=observer.observe(view, jnp.int32(EGO)),
            poses=jnp.where(mask[:, None], poses, 0.0),
            mask=mask,
        )

    return sample
