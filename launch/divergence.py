"""Stops a run whose loss is no number any more, and says where it went wrong."""

import pathlib
from collections.abc import Callable

import numpy as np

from ..learners.base import Mean, Metrics

PARTS = "gradient_norm/"  # before the names of the parts of the parameters


class DivergedError(ValueError):
    """A run whose loss or gradient is not finite."""


def require_finite(
    metrics: Metrics, first: int, folder: pathlib.Path, steps: Callable[[], list[int]]
) -> None:
    """Checks the updates of a call.

    Args:
        metrics: of each update, on the host; with several seeds, of each of them too.
        first: the number of the first of these updates.
        folder: of the run.
        steps: lists those of its checkpoints.

    Raises:
        DivergedError: if a loss or a gradient is not finite; says at which update, the
            gradients of the parts there, and where the run can go on.
    """
    bad = first_wrong(metrics)
    if bad is None:
        return
    norms = ", ".join(
        f"{name.removeprefix(PARTS)} {_texts(mean, bad)}"
        for name, mean in sorted(metrics.items())
        if name.startswith(PARTS)
    )
    saved = steps()
    last = "there is no checkpoint before it"
    if saved:
        last = f"the last good checkpoint is that of update {saved[-1]:,}"
    raise DivergedError(
        f"'{folder}' diverged at update {first + bad:,}: the loss is "
        f"{_texts(metrics['loss'], bad)}, gradient norms are {norms}; {last}; "
        "lower learner.learning_rate or learner.max_gradient_norm in another run, or "
        "find the operation with --debug-nans"
    )


def first_wrong(metrics: Metrics) -> int | None:
    """Returns the first update of which a loss or a gradient is not finite, if any."""
    finite = np.ones(1, bool)
    for name in ("loss", "gradient_norm"):
        totals = metrics[name].total
        finite = finite & np.isfinite(totals).reshape(len(totals), -1).all(axis=1)
    return None if finite.all() else int(np.argmin(finite))


def _texts(mean: Mean, update: int) -> str:
    """Returns the mean of an update; with several seeds, that of each."""
    total, weight = np.ravel(mean.total[update]), np.ravel(mean.weight[update])
    return "/".join(f"{value:.3g}" for value in total / np.where(weight, weight, 1))
