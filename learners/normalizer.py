"""Keeps the mean and the spread of returns, so that critics learn numbers near one."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..sim.records import Record

# Returns nearer to each other count as that far apart: the first ones may be constant.
LEAST_DEVIATION = 1e-2
LEAST_SHARE = 0.2  # of what is seen at one time, in all that was seen


class Normalizer(Record):
    """The moments of the values seen so far, the older ones fading.

    As the moments move, so does what a normalized value means: they must follow faster
    than a critic learns, or it ends off by what they had still to go.
    """

    count: Float[Array, ""]  # of all seen
    mean: Float[Array, ""]
    variance: Float[Array, ""]

    def deviation(self) -> Float[Array, ""]:
        """Returns the standard deviation, 1 as long as nothing was seen."""
        variance = jnp.maximum(self.variance, LEAST_DEVIATION**2)
        return jnp.where(self.count > 0, jnp.sqrt(variance), 1.0)

    def normalize(self, values: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Returns by how many deviations values differ from the mean."""
        return (values - self.mean) / self.deviation()

    def restore(self, values: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Returns the values of which normalized ones are given."""
        return values * self.deviation() + self.mean


def begin() -> Normalizer:
    """Returns the normalizer that has seen nothing and changes nothing."""
    zero = jnp.float32(0.0)
    return Normalizer(count=zero, mean=zero, variance=zero)


def see(
    normalizer: Normalizer,
    values: Float[Array, "*batch"],
    mask: Bool[Array, "*batch"],
    axis_name: str,
) -> Normalizer:
    """Returns the normalizer that has seen the values of all devices too.

    Two sets with means m and variances v, the newer one a share w of both, make one of

        d = m_B - m_A,    m = m_A + w d,    v = (1 - w) v_A + w v_B + w (1 - w) d^2

    (Chan, Golub and LeVeque 1983, equation 2.1). The share is n_B / (n_A + n_B) of
    their counts, until that falls below `LEAST_SHARE`.
    """
    count, mean, squares = moments(values, mask, axis_name)
    total = normalizer.count + count
    share = jnp.maximum(count / jnp.maximum(total, 1.0), LEAST_SHARE)
    share = jnp.where(count > 0, share, 0.0)
    distance, variance = mean - normalizer.mean, squares / jnp.maximum(count, 1.0)
    rest = (1 - share) * (normalizer.variance + share * distance**2)
    return Normalizer(
        count=total,
        mean=normalizer.mean + share * distance,
        variance=rest + share * variance,
    )


def moments(
    values: Float[Array, "*batch"], mask: Bool[Array, "*batch"], axis_name: str
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Returns how many values there are, their mean and summed squared distances."""

    def add(values: Array) -> Array:
        return jax.lax.psum(jnp.sum(jnp.where(mask, values, 0.0)), axis_name)

    count = add(jnp.ones_like(values))
    mean = add(values) / jnp.maximum(count, 1.0)
    return count, mean, add((values - mean) ** 2)
