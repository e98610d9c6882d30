"""Says what to do about a number that is out of range."""

import math
from typing import Any


def require_at_least(config: Any, **least: int) -> None:
    """Checks fields of a config.

    Args:
        config: whose fields.
        **least: the smallest number allowed, by the name of its field.

    Raises:
        ValueError: if one is smaller, or not a number.
    """
    for name, bound in least.items():
        if not getattr(config, name) >= bound:
            raise ValueError(
                f"{name} must be at least {bound}, got {getattr(config, name)}."
            )


def require_finite(config: Any, *names: str) -> None:
    """Checks that fields of a config are at least 0, and finite.

    Raises:
        ValueError: if one is not.
    """
    for name in names:
        if not 0 <= getattr(config, name) < math.inf:
            raise ValueError(
                f"{name} must be at least 0 and finite, got {getattr(config, name)}."
            )


def require_share(config: Any, *names: str) -> None:
    """Checks that fields of a config are from 0 to 1.

    Raises:
        ValueError: if one is not.
    """
    for name in names:
        if not 0 <= getattr(config, name) <= 1:
            raise ValueError(
                f"{name} must be from 0 to 1, got {getattr(config, name)}."
            )
