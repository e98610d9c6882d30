"""Tests of how groups are joined, by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.agents.encoders.fusion import check_steps, side_by_side, split_depth
from drivetrain.agents.encoders.tokens import Tokens


def test_hierarchical_fusion_spends_half_of_the_depth_on_each_level() -> None:
    assert split_depth("early", 4) == (0, 4)
    assert split_depth("late", 4) == (4, 0)
    assert split_depth("hierarchical", 4) == (2, 2)


def test_a_group_of_one_step_is_there_all_the_time() -> None:
    moving = Tokens(
        values=jnp.array([[[1.0], [2.0], [3.0]]]), mask=jnp.array([[True, False, True]])
    )
    static = Tokens(
        values=jnp.array([[[4.0]], [[5.0]]]), mask=jnp.array([[True], [False]])
    )
    scene = side_by_side([moving, static])
    np.testing.assert_array_equal(
        scene.values[..., 0], [[1, 2, 3], [4, 4, 4], [5, 5, 5]]
    )
    np.testing.assert_array_equal(scene.mask, [[1, 0, 1], [1, 1, 1], [0, 0, 0]])


def test_groups_of_unlike_times_are_refused() -> None:
    check_steps({"ego": 11, "objects": 11, "road": 1})
    with pytest.raises(ValueError, match="'lights': 5}; fuse late"):
        check_steps({"ego": 11, "lights": 5})
