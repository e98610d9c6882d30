"""Looks into the checkpoints of runs."""

import pathlib
from typing import Any

import numpy as np
from orbax.checkpoint import v1 as orbax


def arrays(run: pathlib.Path, step: int) -> dict[str, np.ndarray]:
    """Returns the arrays of a checkpoint by name."""
    path = _path(run, step)
    there: Any = orbax.metadata(path).metadata
    like = {name: np.empty(a.shape, a.dtype) for name, a in there.items()}
    return dict(orbax.load(path, like))


def metadata(run: pathlib.Path, step: int) -> str:
    """Returns what stands beside the arrays of a checkpoint."""
    saved: Any = orbax.metadata(_path(run, step)).custom_metadata
    return saved["metadata"]


def _path(run: pathlib.Path, step: int) -> str:
    return str((run / "checkpoints" / str(step)).absolute())
