"""Trains several seeds side by side in one program."""

import jax
from jaxtyping import Array, Key

from .base import Bank, Experience, Learner, Metrics, TrainState

# Where the seeds lie in a train state: behind the strata in the worlds, which are
# shared out among devices along their first axis, and first in all else.
AXES = TrainState(
    params=0,
    opt_state=0,
    step=0,  # pyright: ignore[reportArgumentType]  (an axis for each array)
    key=0,  # pyright: ignore[reportArgumentType]
    kept=0,
    worlds=1,
)


def side_by_side(learner: Learner) -> Learner:
    """Makes a learner of several seeds from that of one.

    `init` takes a key for each seed; what an update does to one does not depend on the
    others, so each ends as it would alone, up to the order of sums.
    """

    def init(keys: Key[Array, " seeds"], bank: Bank, axis_name: str) -> TrainState:
        return jax.vmap(lambda key: learner.init(key, bank, axis_name), out_axes=AXES)(
            keys
        )

    def act(
        train_state: TrainState, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Experience]:
        return jax.vmap(
            lambda state: learner.act(state, bank, axis_name),
            in_axes=(AXES,),
            out_axes=(AXES, 0),
        )(train_state)

    def learn(
        train_state: TrainState, experience: Experience, bank: Bank, axis_name: str
    ) -> tuple[TrainState, Metrics]:
        return jax.vmap(
            lambda state, seen: learner.learn(state, seen, bank, axis_name),
            in_axes=(AXES, 0),
            out_axes=(AXES, 0),
        )(train_state, experience)

    return Learner(init=init, act=act, learn=learn)


def one_of(train_state: TrainState, number: int) -> TrainState:
    """Returns the train state of one of several seeds."""
    return jax.tree.map(
        lambda axis, part: jax.tree.map(lambda leaf: leaf.take(number, axis), part),
        AXES,
        train_state,
    )
