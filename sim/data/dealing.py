"""Deals scenarios out to shards, each the bank of a device."""

EVENNESS = 8  # a stratum has so many scenarios at least, or all have as many


def once(num_scenarios: int, num_shards: int) -> list[list[int]]:
    """Deals each scenario once, to play them all: number j of shard d is j D + d.

    Args:
        num_scenarios: how many there are.
        num_shards: D.

    Returns:
        The numbers of the scenarios of each shard.

    Raises:
        ValueError: if there are fewer scenarios than shards.
    """
    if num_scenarios < num_shards:
        raise ValueError(
            f"{num_scenarios} scenarios cannot be shared by {num_shards} devices: "
            "use at least as many scenarios as devices."
        )
    return [
        list(range(shard, num_scenarios, num_shards)) for shard in range(num_shards)
    ]


def by_stratum(num_scenarios: int, num_shards: int, num_strata: int) -> list[list[int]]:
    """Deals scenarios out to strata, to draw from them whatever the shards are.

    Of L strata, number s has the scenarios s, s + L, and so on. Of D shards, number d
    has the L / D strata from number d L / D on, of each one scenario in turn: number q
    of the shard belongs to its stratum q modulo L / D. A list of few scenarios is gone
    through several times, so that each is drawn about as often as another even if the
    strata do not divide them.

    Args:
        num_scenarios: how many there are, at least one.
        num_shards: D.
        num_strata: L.

    Returns:
        The numbers of the scenarios of each shard.

    Raises:
        ValueError: if the shards do not divide the strata.
    """
    if num_strata % num_shards:
        raise ValueError(
            f"strata must be a multiple of the number of devices, got {num_strata} for "
            f"{num_shards}; set learner.strata."
        )
    total = num_scenarios
    while total % num_strata and total < EVENNESS * num_strata:
        total += num_scenarios
    per_shard = num_strata // num_shards
    shards: list[list[int]] = [[] for _ in range(num_shards)]
    for number in range(total):
        shards[number % num_strata // per_shard].append(number % num_scenarios)
    return shards
