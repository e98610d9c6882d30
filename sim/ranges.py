"""Says what to do about a number that is too small."""

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
