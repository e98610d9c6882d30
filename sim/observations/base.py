"""States what an observation is: named groups of tokens, each with its mask."""

from jaxtyping import Array, Bool, Float

from ..records import Record


class TokenGroup(Record):
    """Things of one kind, each seen over some steps; a map feature has one step."""

    values: Float[Array, "tokens steps features"]  # zero where the mask is False
    mask: Bool[Array, "tokens steps"]  # True where the thing was there


Observation = dict[str, TokenGroup]
