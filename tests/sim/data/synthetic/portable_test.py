"""Tests that one seed gives one scenario on machines whose sines differ."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from drivetrain.sim.data.synthetic import generate as synthetic

SEEDS = range(4)
FUNCTIONS = ("sin", "cos", "arctan2")  # whose last bit is up to the machine


def disturbed(function: Callable, draw: np.random.Generator) -> Callable:
    """Returns the function with results that are one unit in the last place off."""

    def result(*args, **kwargs):
        exact = function(*args, **kwargs)
        way = np.where(draw.uniform(size=np.shape(exact)) < 0.5, -np.inf, np.inf)
        return np.nextafter(exact, way)

    return result


@pytest.mark.parametrize("seed", SEEDS)
def test_the_last_bit_of_sines_does_not_show(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = synthetic.generate(seed)
    draw = np.random.default_rng(seed)
    for name in FUNCTIONS:
        monkeypatch.setattr(np, name, disturbed(getattr(np, name), draw))
    second = synthetic.generate(seed)
    for part in ("tracks", "roads", "lights", "lane_links", "paths"):
        a, b = getattr(first, part), getattr(second, part)
        for field in dataclasses.fields(a):
            np.testing.assert_array_equal(
                getattr(a, field.name), getattr(b, field.name), err_msg=field.name
            )
