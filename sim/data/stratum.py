"""Divides the scenarios of a bank, so that draws do not depend on the devices."""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Int, PRNGKeyArray

from ..records import Record
from .bank import Bank


class Stratum(Record):
    """Every so many-th scenario of the bank of one device.

    Of L strata, number s has the scenarios whose number is s modulo L, and each of D
    devices has L / D strata in a row, of each one scenario in turn
    (`dealing.by_stratum`). Who draws from a stratum draws the same ones whatever D is,
    but for streams, of which each device has pages of its own.
    """

    first: Int[Array, ""]  # among the scenarios of the device
    stride: int = struct.field(pytree_node=False)  # L / D

    def draw(self, bank: Bank, key: PRNGKeyArray) -> Int[Array, ""]:
        """Draws the number of a scenario, each of the stratum as likely as another.

        Where the device has fewer scenarios than strata, as a stream may, and this one
        has none, all of the device are as likely.
        """
        total = bank.num_scenarios
        count = (total - self.first + self.stride - 1) // self.stride
        own_key, any_key = jax.random.split(key)
        own = self.first + self.stride * jax.random.randint(
            own_key, (), 0, jnp.maximum(count, 1)
        )
        return jnp.where(count > 0, own, jax.random.randint(any_key, (), 0, total))


def whole() -> Stratum:
    """Returns the stratum of all scenarios of a device."""
    return Stratum(first=jnp.int32(0), stride=1)
