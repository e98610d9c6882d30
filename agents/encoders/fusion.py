"""Joins the token groups of an observation into one scene."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp

from .tokens import Tokens

FUSIONS = ("early", "late", "hierarchical")


def split_depth(fusion: str, num_layers: int) -> tuple[int, int]:
    """Returns the layers of each group's own encoder, and those of the joint one.

    Early fusion has the joint encoder alone, late fusion one for each group alone, and
    hierarchical fusion spends half of the depth on each (Nayakanti et al. 2022,
    section 3). Depth and width are the same in all groups.
    """
    half = num_layers // 2
    return {
        "early": (0, num_layers),
        "late": (num_layers, 0),
        "hierarchical": (half, half),
    }[fusion]


def check_steps(steps: Mapping[str, int]) -> None:
    """Checks that groups of these numbers of steps can share one axis of time.

    Raises:
        ValueError: if two groups have several steps, but not the same number.
    """
    if len({count for count in steps.values() if count > 1}) > 1:
        raise ValueError(
            "factorized attention among groups needs groups of one step or of the same "
            f"number of steps, got {dict(steps)}; fuse late, or attend multi_axis."
        )


def side_by_side(groups: Sequence[Tokens]) -> Tokens:
    """Joins groups on one axis of tokens, and on one axis of steps.

    What has one step, such as the road, was there all the time: it is repeated.
    """
    num_steps = max(group.mask.shape[1] for group in groups)
    repeats = [num_steps // group.mask.shape[1] for group in groups]
    both = list(zip(groups, repeats, strict=True))
    return Tokens(
        values=jnp.concatenate([jnp.repeat(g.values, n, axis=1) for g, n in both]),
        mask=jnp.concatenate([jnp.repeat(g.mask, n, axis=1) for g, n in both]),
    )
