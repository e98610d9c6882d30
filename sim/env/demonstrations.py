"""Shows what the expert of the log did: observations with the action that followed."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from ..data.bank import Bank
from ..data.stratum import Stratum
from ..dynamics.base import Action, Dynamics
from ..metrics.build import EGO
from ..motions import object_of
from ..observations.base import Observation, Observer
from ..records import Record
from .logged_views import logged_view


class Demonstration(Record):
    """One step of the expert."""

    observation: Observation
    action: Action
    weight: Float[Array, ""]  # 0 where the log lacks the ego before or after the step


Sample = Callable[[Bank, Stratum, PRNGKeyArray], Demonstration]


def demonstrations(dynamics: Dynamics, observer: Observer) -> Sample:
    """Builds the function that draws one demonstration of a bank.

    A scenario of the stratum and a simulated step are drawn uniformly; the observation
    is that of the log, the action the inverse dynamics between two logged motions.
    """

    def sample(bank: Bank, stratum: Stratum, key: PRNGKeyArray) -> Demonstration:
        view = logged_view(dynamics, observer, bank, stratum, key)
        now = jax.tree.map(lambda leaf: leaf[-1], view.motion)
        here = object_of(now, EGO)
        there = object_of(view.scene.log_at(view.step + 1), EGO)
        return Demonstration(
            observation=observer.observe(view, jnp.int32(EGO)),
            action=dynamics.inverse(here, there, view.object_size[EGO], bank.dt),
            weight=(here.valid & there.valid).astype(jnp.float32),
        )

    return sample
