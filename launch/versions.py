"""Says with what a run is made: what may change its last digits beside the config."""

import platform
from collections.abc import Mapping
from importlib import metadata

import jax

PACKAGES = ("drivetrain", "jax", "jaxlib", "flax", "optax", "orbax-checkpoint")


def here() -> dict[str, str]:
    """Returns the versions of the packages, of Python, and the kind of device."""
    return {
        **{name: metadata.version(name) for name in PACKAGES},
        "Python": platform.python_version(),
        "device": jax.devices()[0].device_kind,
    }


def changes(before: Mapping[str, str]) -> list[str]:
    """Lists what is another version here, as `jax 0.11.0, before 0.10.2`."""
    return [
        f"{name} {version}, before {before.get(name, 'unknown')}"
        for name, version in here().items()
        if before.get(name) != version
    ]
