"""Tests the distance to every path against the oracle."""

import numpy as np
import pytest

from tests import changes, worlds
from tests.oracles import routes as oracle


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_wrong_ways_are_those_of_the_oracle(kind: str) -> None:
    for scenario, moment, measures in worlds.samples(kind):
        paths = worlds.paths_of(scenario)
        places = np.float64(moment.after.xy[0]) + worlds.NUDGES
        answers = [oracle.wrong_way(place, paths) for place in places]
        verdict = bool(measures["wrong_way"].value > 0)
        assert verdict in [verdict for verdict, _ in answers]
        distance = float(measures["path_distance"].value)
        assert distance == pytest.approx(answers[0][1], abs=worlds.ROUNDING)


def test_the_way_is_wrong_where_the_oracle_says() -> None:
    verdicts = []
    for scenario, moment, _ in worlds.samples("generated")[:9:3]:
        for offset in np.float32(np.arange(-15, 15, 0.77)):
            xyz = moment.logged.xyz.at[0, :2].add(offset)
            moved = moment.replace(after=moment.logged.replace(xyz=xyz))
            place, paths = np.float64(xyz[0, :2]), worlds.paths_of(scenario)
            verdict, _ = oracle.wrong_way(place, paths)
            assert bool(worlds.measure(moved)["wrong_way"].value > 0) is verdict
            verdicts.append(verdict)
    assert 0.2 < np.mean(verdicts) < 0.8  # else the places prove nothing


@pytest.mark.parametrize("name", ["wrong_way", "path_distance"])
@pytest.mark.parametrize("change", changes.CHANGES)
def test_the_distance_is_kept(change: str, name: str) -> None:
    changes.assert_kept(change, name, 0 if name == "wrong_way" else worlds.ROUNDING)
