"""Embeds the token groups of an observation as one sequence of tokens."""

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, Float

from ...sim.observations.base import Observation, TokenGroup


class GroupEmbedding(nnx.Module):
    """Embeds the (token, step) pairs of one group.

    The learned table tells steps apart and, each group having its own, groups as well.
    The order of the tokens says nothing: objects and map features are sets, and those
    sorted by distance swap places from one step to the next.
    """

    def __init__(self, group: TokenGroup, width: int, *, rngs: nnx.Rngs):
        """Draws parameters for groups of this one's steps and features."""
        _, num_steps, num_features = group.values.shape
        self.projection = nnx.Linear(num_features, width, rngs=rngs)
        self.step_embedding = nnx.Embed(num_steps, width, rngs=rngs)

    def __call__(self, group: TokenGroup) -> Float[Array, "pairs width"]:
        """Embeds a group, steps running faster than tokens."""
        present = jnp.where(group.mask[..., None], group.values, 0.0)
        embedded = self.projection(present) + self.step_embedding.embedding[None]
        return embedded.reshape(-1, embedded.shape[-1])


class TokenEmbedding(nnx.Module):
    """Embeds all groups of an observation."""

    def __init__(self, observation: Observation, width: int, *, rngs: nnx.Rngs):
        """Draws parameters for observations of this one's groups and shapes."""
        self.groups = nnx.Dict(
            {
                name: GroupEmbedding(group, width, rngs=rngs)
                for name, group in sorted(observation.items())
            }
        )

    def __call__(
        self, observation: Observation
    ) -> tuple[Float[Array, "pairs width"], Bool[Array, " pairs"]]:
        """Embeds every (token, step) pair of every group.

        Returns:
            The embeddings in one sequence, and the mask of those that are present.

        Raises:
            ValueError: if the groups are not those that the parameters were drawn for.
        """
        names = list(self.groups)
        if sorted(observation) != names:
            raise ValueError(
                f"the observation has the groups {sorted(observation)}, but the "
                f"network was built for {names}; build the agent on this kind."
            )
        tokens = [self.groups[name](observation[name]) for name in names]
        masks = [observation[name].mask.reshape(-1) for name in names]
        return jnp.concatenate(tokens), jnp.concatenate(masks)
