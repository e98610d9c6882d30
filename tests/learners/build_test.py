"""Tests that configs become learners, and that wrong ones are named."""

import pytest

from drivetrain.learners import build
from drivetrain.learners.bc import CloningConfig
from tests.learners import toy


def test_each_known_learner_is_built() -> None:
    assert build.build(CloningConfig(), toy.linear_agent(), toy.sampler(toy.sign))


@pytest.mark.parametrize("fields", [{"batch_size": 0}, {"batch_size": 12}])
def test_a_batch_that_strata_do_not_divide_is_refused(fields: dict) -> None:
    with pytest.raises(ValueError, match="batch_size must be a positive multiple"):
        CloningConfig(**fields)
