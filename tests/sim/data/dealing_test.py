"""Tests that scenarios are dealt so that what is drawn does not depend on devices."""

import pytest

from drivetrain.sim.data import dealing

NUM_STRATA = 8


def strata_of(dealt: list[list[int]]) -> list[list[int]]:
    """Returns the scenarios of each stratum, as `stratum.Stratum` finds them."""
    per_shard = NUM_STRATA // len(dealt)
    return [own[first::per_shard] for own in dealt for first in range(per_shard)]


@pytest.mark.parametrize("num_shards", [1, 2, 3, 5])
def test_each_is_dealt_once_in_turn(num_shards: int) -> None:
    dealt = dealing.once(5, num_shards)
    assert sorted(number for own in dealt for number in own) == [0, 1, 2, 3, 4]
    for shard, own in enumerate(dealt):
        for place, number in enumerate(own):
            assert number == place * num_shards + shard


def test_fewer_scenarios_than_devices_are_refused() -> None:
    with pytest.raises(ValueError, match="5 scenarios cannot be shared by 6 devices"):
        dealing.once(5, 6)


@pytest.mark.parametrize("num_scenarios", [1, 3, 8, 20, 100])
@pytest.mark.parametrize("num_shards", [2, 4, 8])
def test_strata_have_the_same_scenarios_on_any_number_of_devices(
    num_scenarios: int, num_shards: int
) -> None:
    alone = dealing.by_stratum(num_scenarios, 1, NUM_STRATA)
    shared = dealing.by_stratum(num_scenarios, num_shards, NUM_STRATA)
    assert strata_of(shared) == strata_of(alone)


@pytest.mark.parametrize("num_scenarios", [1, 3, 5, 7, 8, 9, 20, 63, 64, 65, 1000])
def test_each_scenario_is_about_as_likely_as_another(num_scenarios: int) -> None:
    chances = dict.fromkeys(range(num_scenarios), 0.0)
    for own in strata_of(dealing.by_stratum(num_scenarios, 1, NUM_STRATA)):
        for number in own:
            chances[number] += 1 / (NUM_STRATA * len(own))
    # A stratum may have one scenario more than another, of `EVENNESS` at least.
    assert max(chances.values()) <= min(chances.values()) * (1 + 1 / dealing.EVENNESS)


def test_enough_scenarios_are_dealt_once() -> None:
    dealt = dealing.by_stratum(65, 2, NUM_STRATA)
    assert sorted(number for own in dealt for number in own) == list(range(65))


def test_strata_that_devices_do_not_divide_are_refused() -> None:
    with pytest.raises(ValueError, match=r"got 8 for 3; set learner\.strata"):
        dealing.by_stratum(20, 3, NUM_STRATA)
