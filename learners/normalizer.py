"""Keeps the mean and the spread of returns, so that critics learn numbers near one."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..sim.records import Record

# Returns nearer to each other count as that far apart: the first ones may be constant.
LEAST_DEVIATION = 1e-2


class Normalizer(Record):
    """The moments of all values seen so far.

    Sums of float32 stop growing at some 1e11 values; from there on newer ones replace
    older ones, which is what is wanted of returns anyway. As the moments move, so does
    what a normalized value means: `change_from` tells what is to become of a critic.
    """

    count: Float[Array, ""]
    mean: Float[Array, ""]
    squares: Float[Array, ""]  # summed, of the distances to the mean

    def deviation(self) -> Float[Array, ""]:
        """Returns the standard deviation, 1 as long as nothing was seen."""
        variance = self.squares / jnp.maximum(self.count, 1.0)
        variance = jnp.maximum(variance, LEAST_DEVIATION**2)
        return jnp.where(self.count > 0, jnp.sqrt(variance), 1.0)

    def normalize(self, values: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Returns by how many deviations values differ from the mean."""
        return (values - self.mean) / self.deviation()

    def restore(self, values: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Returns the values of which normalized ones are given."""
        return values * self.deviation() + self.mean

    def change_from(
        self, older: "Normalizer"
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Returns factor f and offset o by which values keep what they mean.

            f = s / s',    o = (m - m') / s'

        of mean m and deviation s before, m' and s' now: a value v that was normalized
        by the older moments is f v + o by these. If those had seen nothing, a value
        meant nothing yet, and stays.
        """
        deviation, known = self.deviation(), older.count > 0
        factor = jnp.where(known, older.deviation() / deviation, 1.0)
        return factor, jnp.where(known, (older.mean - self.mean) / deviation, 0.0)


def begin() -> Normalizer:
    """Returns the normalizer that has seen nothing and changes nothing."""
    zero = jnp.float32(0.0)
    return Normalizer(count=zero, mean=zero, squares=zero)


def see(
    normalizer: Normalizer,
    values: Float[Array, "*batch"],
    mask: Bool[Array, "*batch"],
    axis_name: str,
) -> Normalizer:
    """Returns the normalizer that has seen the values of all devices too.

    Two sets of n_A and n_B values with means m and squared distances S make one of

        d = m_B - m_A,    n = n_A + n_B
        m = m_A + d n_B / n,    S = S_A + S_B + d^2 n_A n_B / n

    (Chan, Golub and LeVeque 1983, equation 2.1).
    """
    count, mean, squares = moments(values, mask, axis_name)
    total = jnp.maximum(normalizer.count + count, 1.0)
    share, distance = count / total, mean - normalizer.mean
    return Normalizer(
        count=normalizer.count + count,
        mean=normalizer.mean + distance * share,
        squares=normalizer.squares + squares + distance**2 * normalizer.count * share,
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
