"""Tests that configs become learners, and that wrong ones are named."""

import pytest

from drivetrain.learners import build
from drivetrain.learners.build import LearnerConfig
from tests.learners import toy


@pytest.mark.parametrize("name", build.KNOWN)
def test_each_known_learner_is_built(name: str) -> None:
    config = LearnerConfig(name=name)
    assert build.build(config, toy.linear_agent(), toy.sampler(toy.sign))


def test_an_unknown_learner_is_named_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"unknown learner 'cb'.* Known: bc"):
        LearnerConfig(name="cb")


def test_an_empty_batch_is_refused() -> None:
    with pytest.raises(ValueError, match="batch_size must be at least 1"):
        LearnerConfig(batch_size=0)
