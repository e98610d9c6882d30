"""Tests that a run whose loss is no number is stopped with what helps to mend it."""

import pathlib

import numpy as np
import pytest

from drivetrain.launch.divergence import DivergedError, require_finite
from drivetrain.learners.base import Mean

RUN = pathlib.Path("run")


def metrics(loss: list[float], encoder: list[float], weight: float) -> dict[str, Mean]:
    """Returns metrics of updates as a program gives them, sums and their weights."""
    weights = np.full(len(loss), weight)
    means = {
        "loss": loss,
        "gradient_norm": encoder,
        "gradient_norm/encoder": encoder,
        "gradient_norm/head": [0.5] * len(loss),
    }
    return {
        name: Mean(total=np.array(values) * weight, weight=weights)
        for name, values in means.items()
    }


def test_finite_updates_go_on() -> None:
    require_finite(metrics([5.0, 1e30], [2.0, 3.0], 256.0), 7, RUN, lambda: [])


@pytest.mark.parametrize("weight", [1.0, 256.0])
def test_the_update_its_means_and_the_checkpoint_are_named(weight: float) -> None:
    told = metrics([5.0, 4.0, 3.0], [2.0, np.inf, np.nan], weight)
    with pytest.raises(DivergedError) as caught:
        require_finite(told, 7, RUN, lambda: [2, 6])
    sentence = str(caught.value)
    assert "diverged at update 8: the loss is 4, " in sentence
    assert "encoder inf, head 0.5;" in sentence
    assert "checkpoint is that of update 6" in sentence


def test_of_several_seeds_each_is_told() -> None:
    told = {
        name: Mean(
            total=np.stack([mean.total, 2 * mean.total], axis=1),
            weight=np.stack([mean.weight] * 2, axis=1),
        )
        for name, mean in metrics([np.nan], [3.0], 4.0).items()
    }
    with pytest.raises(DivergedError, match=r"the loss is nan/nan.*encoder 3/6"):
        require_finite(told, 1, RUN, lambda: [])
