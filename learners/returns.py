"""Says what the actions of one actor turned out to be worth.

At time t, reward r_t and discount d_t follow the action, and v_t is the value before
it. A step without mask, m_t = 0, ends what came before: of it only the value counts,
which bootstraps the step before unless that has a discount of 0 (`acting.Step`).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..sim.records import Record


class Course(Record):
    """What happened to one actor in a row."""

    reward: Float[Array, " steps"]
    discount: Float[Array, " steps"]  # of all that follows, gamma included
    value: Float[Array, " steps+1"]  # before each step and after the last
    mask: Bool[Array, " steps"]


class Worth(Record):
    """What actions were worth; zero where the mask of the step is False."""

    advantage: Float[Array, " steps"]  # over what was to be expected
    target: Float[Array, " steps"]  # of the value before the action


def generalized_advantage(course: Course, decay: float) -> Worth:
    """Estimates advantages from rewards and values.

    With decay l (Schulman et al. 2016, equations 16 and 12, cut where an episode is;
    the target is that of Schulman et al. 2017, section 5):

        delta_t = r_t + d_t v_{t+1} - v_t
        A_t = delta_t + d_t l m_{t+1} A_{t+1},    target_t = A_t + v_t
    """
    value_t, value_tp1 = course.value[:-1], course.value[1:]
    delta = course.reward + course.discount * value_tp1 - value_t
    advantage = _accumulate(delta, course.discount * decay * _goes_on(course))
    return _masked(course, advantage, advantage + value_t)


def vtrace(course: Course, ratio: Float[Array, " steps"], decay: float) -> Worth:
    """Estimates what actions of an older policy are worth to the present one.

    With ratios w_t of their probabilities, present to older, and decay l (Espeholt et
    al. 2018, equation 1 and remark 2, with thresholds of 1; l_t = l m_{t+1}):

        delta_t = min(1, w_t) (r_t + d_t v_{t+1} - v_t)
        target_t - v_t = delta_t + d_t l_t min(1, w_t) (target_{t+1} - v_{t+1})
        A_t = r_t + d_t (l_t target_{t+1} + (1 - l_t) v_{t+1}) - v_t

    Departs from it in that the advantage is not weighed by the ratio: the ratio of PPO
    does that.

    Args:
        course: with the values of the present policy.
        ratio: present to older probability; of masked steps it may be anything.
        decay: between looking one step ahead, 0, and to the end, 1.
    """
    value_t, value_tp1 = course.value[:-1], course.value[1:]
    weight = jnp.minimum(jnp.where(course.mask, ratio, 1.0), 1.0)
    decays = decay * _goes_on(course)
    delta = weight * (course.reward + course.discount * value_tp1 - value_t)
    error = _accumulate(delta, course.discount * decays * weight)
    error_tp1 = jnp.concatenate([error[1:], jnp.zeros_like(error[:1])])
    ahead = value_tp1 + decays * error_tp1
    advantage = course.reward + course.discount * ahead - value_t
    return _masked(course, advantage, error + value_t)


def _goes_on(course: Course) -> Float[Array, " steps"]:
    """Returns m_{t+1}; nothing is known of the last."""
    following = [course.mask[1:], jnp.zeros_like(course.mask[:1])]
    return jnp.concatenate(following).astype(jnp.float32)


def _accumulate(
    delta: Float[Array, " steps"], decay: Float[Array, " steps"]
) -> Float[Array, " steps"]:
    """Returns x_t = delta_t + decay_t x_{t+1}, from nothing after the last step."""

    def add(following: Array, own: tuple[Array, Array]) -> tuple[Array, Array]:
        total = own[0] + own[1] * following
        return total, total

    last = delta[-1]  # not zeros, which a device would not hold as its own
    _, before = jax.lax.scan(add, last, (delta[:-1], decay[:-1]), reverse=True)
    return jnp.concatenate([before, last[None]])


def _masked(course: Course, advantage: Array, target: Array) -> Worth:
    return Worth(
        advantage=jnp.where(course.mask, advantage, 0.0),
        target=jnp.where(course.mask, target, 0.0),
    )
