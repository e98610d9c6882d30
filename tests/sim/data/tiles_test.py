"""Tests of the tiles of a map: each piece lies where its tile says."""

import numpy as np
import pytest

from drivetrain.sim.data import tiles
from drivetrain.sim.data.pack import PackConfig, pack
from drivetrain.sim.data.packed import JOINED
from drivetrain.sim.scenario import ScenarioError
from tests import worlds


@pytest.mark.parametrize("kind", worlds.KINDS)
@pytest.mark.parametrize("quantize", [True, False])
def test_every_piece_is_in_the_tile_of_its_middle_and_in_no_other(kind, quantize):
    for scenario in worlds.scenarios(kind):
        packed = pack(scenario, PackConfig(quantize=quantize))
        vertices = packed.centre + packed.quantum * packed.vertices.astype(np.float64)
        joined = packed.vertex_tag >= JOINED
        ended = np.append(False, joined[:-1])
        listed = packed.tile_pieces[: packed.tile_starts[-1]].astype(int)
        np.testing.assert_array_equal(np.sort(listed), np.flatnonzero(joined | ~ended))
        end = np.where(joined[listed], listed + 1, listed)
        middle = (vertices[listed] + vertices[end])[:, :2] / 2
        tile = np.repeat(
            np.arange(packed.tile_shape.prod()), np.diff(packed.tile_starts)
        )
        cell = np.stack([tile % packed.tile_shape[0], tile // packed.tile_shape[0]], 1)
        offset = middle - packed.tile_corner - cell * tiles.TILE
        rounding = 1e-3  # of float32 centres and corners up to some km
        assert (offset > -rounding).all() and (offset < tiles.TILE + rounding).all()
        longest = np.linalg.norm((vertices[end] - vertices[listed])[:, :2], axis=1)
        assert packed.tile_reach == pytest.approx(longest.max() / 2, abs=rounding)


def test_simplified_lines_keep_a_point_every_so_often() -> None:
    scenario = worlds.scenarios("real")[0]
    quantized = pack(scenario, PackConfig())
    # One step of the logged points, of half a metre, may come on top.
    assert quantized.tile_reach <= (tiles.MAX_PIECE + 1.0) / 2


def test_a_map_of_too_many_vertices_is_refused() -> None:
    count = tiles.MAX_VERTICES + 1
    with pytest.raises(ScenarioError, match=r"65,537 vertices .* at most 65,536"):
        tiles.build(np.zeros((count, 3)), np.ones(count, bool))
