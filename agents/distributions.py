"""States the distributions over actions that policies return.

Actions are in the environment's units. Batches arise by vmap.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float, Int, Key

from ..sim.dynamics.base import Continuous
from ..sim.records import Record
from .factored import FactoredCategorical

# An action on a bound has an infinite pre-image under tanh: keep this far inside.
SQUASHED_LIMIT = 1 - 1e-3


class Categorical(Record):
    """A choice among numbered actions."""

    logits: Float[Array, " actions"]

    def log_prob(self, action: Int[Array, ""]) -> Float[Array, ""]:
        """Returns the logarithm of the probability of an action."""
        return jax.nn.log_softmax(self.logits)[action]

    def sample(self, key: Key[Array, ""]) -> Int[Array, ""]:
        """Draws an action."""
        return jax.random.categorical(key, self.logits).astype(jnp.int32)

    def mode(self) -> Int[Array, ""]:
        """Returns the most likely action."""
        return jnp.argmax(self.logits).astype(jnp.int32)

    def entropy(self, key: Key[Array, ""]) -> Float[Array, ""]:
        """Returns the entropy -sum p log p [nats], exactly: the key is not used."""
        del key
        log_prob = jax.nn.log_softmax(self.logits)
        # An action ruled out, of probability 0, adds nothing, nor to the gradient.
        finite = jnp.where(log_prob > -jnp.inf, log_prob, 0.0)
        return -jnp.sum(jnp.exp(log_prob) * finite)


class ActionValues(Record):
    """What each of some numbered actions is worth: the greedy policy over them."""

    values: Float[Array, " actions"]  # expected returns

    def mode(self) -> Int[Array, ""]:
        """Returns the action of the highest value, the first of several."""
        return jnp.argmax(self.values).astype(jnp.int32)


class TanhMixture(Record):
    """A mixture of Gaussians with diagonal covariance, squashed into bounds by tanh.

    With component weights w, means m and scales s, the action a has the density

        y = 2 (a - low) / (high - low) - 1,    u = atanh(y)
        p(a) = sum_k w_k N(u; m_k, s_k) / prod_i [(1 - y_i^2) (high_i - low_i) / 2]

    (the head of Gulino et al. 2023, A.2). Departs from it where |y| > 1 - 1e-3: such an
    action counts as one at that distance from the bound, where experts do act.
    """

    logits: Float[Array, " components"]  # of the weights
    mean: Float[Array, "components features"]
    scale: Float[Array, "components features"]  # positive
    bounds: Continuous = struct.field(pytree_node=False)

    def log_prob(self, action: Float[Array, " features"]) -> Float[Array, ""]:
        """Returns the logarithm of the density of an action [1 / its unit]."""
        low, high = jnp.array(self.bounds.low), jnp.array(self.bounds.high)
        squashed = 2 * (action - low) / (high - low) - 1
        squashed = jnp.clip(squashed, -SQUASHED_LIMIT, SQUASHED_LIMIT)

        mixture = self._log_prob_before(jnp.arctanh(squashed))
        stretch = jnp.log1p(-(squashed**2)) + jnp.log((high - low) / 2)
        return mixture - stretch.sum()

    def sample(self, key: Key[Array, ""]) -> Float[Array, " features"]:
        """Draws an action."""
        component_key, noise_key = jax.random.split(key)
        component = jax.random.categorical(component_key, self.logits)
        mean, scale = self.mean[component], self.scale[component]
        return self._squash(mean + scale * jax.random.normal(noise_key, mean.shape))

    def mode(self) -> Float[Array, " features"]:
        """Returns the centre of the most likely component."""
        return self._squash(self.mean[jnp.argmax(self.logits)])

    def entropy(self, key: Key[Array, ""]) -> Float[Array, ""]:
        """Estimates the entropy [nats, actions in their units] from a few draws.

        With u_k = m_k + s_k z_k, of one normal draw z_k a component, it is

            -sum_k w_k log p(a(u_k))

        whose mean is the entropy, and whose gradient has the mean of its gradient: no
        draw among the components is in it. Unlike `log_prob` it counts actions near a
        bound as they are.
        """
        low, high = jnp.array(self.bounds.low), jnp.array(self.bounds.high)
        u = self.mean + self.scale * jax.random.normal(key, self.mean.shape)
        density = jax.vmap(self._log_prob_before)(u)
        # log (1 - tanh(u)^2), finite where tanh rounds to 1.
        squeeze = 2 * (jnp.log(2.0) - u - jax.nn.softplus(-2 * u))
        stretch = jnp.sum(squeeze + jnp.log((high - low) / 2)[None], axis=-1)
        return jnp.sum(jax.nn.softmax(self.logits) * (stretch - density))

    def _log_prob_before(self, u: Float[Array, " features"]) -> Float[Array, ""]:
        """Returns the logarithm of the density before squashing."""
        deviation = (u[None] - self.mean) / self.scale
        normal = -0.5 * deviation**2 - jnp.log(self.scale) - 0.5 * jnp.log(2 * jnp.pi)
        weight = jax.nn.log_softmax(self.logits)
        return jax.nn.logsumexp(weight + normal.sum(axis=-1))

    def _squash(self, u: Float[Array, " features"]) -> Float[Array, " features"]:
        low, high = jnp.array(self.bounds.low), jnp.array(self.bounds.high)
        action = low + (jnp.tanh(u) + 1) / 2 * (high - low)
        return jnp.clip(action, low, high)  # rounding may step over the bound


Distribution = Categorical | FactoredCategorical | TanhMixture
