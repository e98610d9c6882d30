"""States a choice of several numbers at once, each by a softmax of its own."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from ..sim.records import Record


class FactoredCategorical(Record):
    """Independent choices, joined in one numbered action.

        p(a) = prod_i p_i(a_i),    a = (a_1 n_2 + a_2) n_3 + ...

    for factors of n_i bins: the first is the slowest, as in discrete dynamics. So does
    Nocturne's imitation choose acceleration and steering (Vinitsky et al. 2022, A.1).
    """

    logits: tuple[Float[Array, " _"], ...]  # of the bins of each factor

    def log_prob(self, action: Int[Array, ""]) -> Float[Array, ""]:
        """Returns the logarithm of the probability of an action."""
        bins = jnp.unravel_index(action, self._num_bins())
        factors = zip(self.logits, bins, strict=True)
        return jnp.stack([jax.nn.log_softmax(x)[i] for x, i in factors]).sum()

    def sample(self, key: Key[Array, ""]) -> Int[Array, ""]:
        """Draws an action."""
        keys = jax.random.split(key, len(self.logits))
        factors = zip(keys, self.logits, strict=True)
        return self._joined([jax.random.categorical(k, x) for k, x in factors])

    def mode(self) -> Int[Array, ""]:
        """Returns the most likely action."""
        return self._joined([jnp.argmax(logits) for logits in self.logits])

    def entropy(self, key: Key[Array, ""]) -> Float[Array, ""]:
        """Returns the entropy [nats], the sum of those of the factors, exactly."""
        del key
        log_probs = [jax.nn.log_softmax(logits) for logits in self.logits]
        return -jnp.stack([jnp.sum(jnp.exp(x) * x) for x in log_probs]).sum()

    def _num_bins(self) -> tuple[int, ...]:
        return tuple(logits.shape[-1] for logits in self.logits)

    def _joined(self, bins: list[Int[Array, ""]]) -> Int[Array, ""]:
        joined = jnp.zeros((), jnp.int32)
        for number, count in zip(bins, self._num_bins(), strict=True):
            joined = joined * count + number.astype(jnp.int32)
        return joined
