"""Embeds the token groups of an observation, each on its grid of tokens and steps."""

import jax.numpy as jnp
from flax import nnx
from jaxtyping import Array, Bool, DTypeLike, Float

from ...sim.observations.base import Observation, TokenGroup
from ...sim.records import Record


class Tokens(Record):
    """Embedded tokens, each over some steps."""

    values: Float[Array, "tokens steps width"]
    mask: Bool[Array, "tokens steps"]  # where False, values mean nothing


class GroupEmbedding(nnx.Module):
    """Embeds the (token, step) pairs of one group.

    The learned table tells steps apart and, each group having its own, groups as well.
    A second table, if asked for, tells tokens apart by their number in the group, as in
    Nayakanti et al. 2022. By default the order of the tokens says nothing: objects and
    map features are sets, and those sorted by distance swap places from one step to the
    next. It says something where a number means a role, as along a route.
    """

    def __init__(
        self,
        group: TokenGroup,
        width: int,
        *,
        positions: bool = False,
        dtype: DTypeLike = jnp.float32,
        rngs: nnx.Rngs,
    ):
        """Draws parameters for groups of this one's shape."""
        num_tokens, num_steps, num_features = group.values.shape
        self.projection = nnx.Linear(num_features, width, dtype=dtype, rngs=rngs)
        self.step_embedding = nnx.Embed(num_steps, width, rngs=rngs)
        self.position_embedding = (
            nnx.Embed(num_tokens, width, rngs=rngs) if positions else None
        )

    def __call__(self, group: TokenGroup) -> Tokens:
        """Embeds a group."""
        present = jnp.where(group.mask[..., None], group.values, 0.0)
        embedded = self.projection(present) + self.step_embedding.embedding[None]
        if self.position_embedding is not None:
            embedded = embedded + self.position_embedding.embedding[:, None]
        return Tokens(values=embedded, mask=group.mask)


class TokenEmbedding(nnx.Module):
    """Embeds all groups of an observation."""

    def __init__(
        self,
        observation: Observation,
        width: int,
        *,
        positions: bool = False,
        dtype: DTypeLike = jnp.float32,
        rngs: nnx.Rngs,
    ):
        """Draws parameters for observations of this one's groups and shapes."""
        self.groups = nnx.Dict(
            {
                name: GroupEmbedding(
                    group, width, positions=positions, dtype=dtype, rngs=rngs
                )
                for name, group in sorted(observation.items())
            }
        )

    def __call__(self, observation: Observation) -> dict[str, Tokens]:
        """Embeds every (token, step) pair of every group.

        Raises:
            ValueError: if the groups are not those that the parameters were drawn for.
        """
        names = list(self.groups)
        if sorted(observation) != names:
            raise ValueError(
                f"the observation has the groups {sorted(observation)}, but the "
                f"network was built for {names}; build the agent on this kind."
            )
        return {name: self.groups[name](observation[name]) for name in names}
