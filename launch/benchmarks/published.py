"""The papers' own figures, printed beside ours.

W: Waymax, table 2 (128 objects; Intel Xeon W-2135, or one V100) and, where that has no
figure, table 6 (AMD EPYC 7B12, or one V100; its environment is not named). N: Nocturne,
appendix F (one core of an unnamed CPU).
"""

WAYMAX_COLUMNS = ("reset_ms", "step_ms", "transition_ms", "metrics_ms", "rollout_ms")

# By environment, platform and batch, at 128 objects.
WAYMAX_TABLE_2 = {
    ("planning", "cpu", 1): (1.09, 131, 0.90, 112, 10_000),
    ("planning", "cpu", 16): (12.2, 1700, 10.9, 1690, 140_000),
    ("planning", "gpu", 1): (0.58, 0.75, 0.47, 0.21, 56.2),
    ("planning", "gpu", 16): (0.67, 2.48, 0.52, 2.27, 279),
    ("multi_agent", "cpu", 1): (6.23, 129, 1.01, 112, 11_000),
    ("multi_agent", "cpu", 16): (49.8, 1100, 14.3, 1720, 160_000),
    ("multi_agent", "gpu", 1): (0.64, 0.92, 0.53, 0.19, 73.3),
    ("multi_agent", "gpu", 16): (0.81, 2.86, 0.51, 2.24, None),
}

# Reset, transition, metrics and rollout [ms] and memory [MB], by platform, batch and
# objects.
WAYMAX_TABLE_6 = {
    ("cpu", 1, 8): (0.194, 0.191, 0.773, 121.492, 5.409),
    ("cpu", 1, 16): (0.184, 0.176, 1.431, 190.357, 5.590),
    ("cpu", 1, 32): (0.197, 0.223, 2.428, 378.926, 5.956),
    ("cpu", 1, 64): (0.225, 0.221, 4.468, 637.125, 6.652),
    ("cpu", 1, 128): (0.286, 0.274, 9.831, 1159.158, 8.036),
    ("cpu", 16, 8): (1.741, 2.004, 10.689, None, 84.066),
    ("cpu", 16, 16): (1.744, 1.894, 20.069, None, 86.805),
    ("cpu", 16, 32): (2.084, 2.414, 33.002, None, 92.283),
    ("cpu", 16, 64): (2.575, 2.648, 66.486, None, 103.239),
    ("cpu", 16, 128): (2.837, 3.080, 124.530, None, 125.151),
    ("gpu", 1, 8): (0.250, 0.265, 0.159, 27.010, None),
    ("gpu", 1, 16): (0.253, 0.267, 0.158, 28.041, None),
    ("gpu", 1, 32): (0.258, 0.268, 0.208, 30.488, None),
    ("gpu", 1, 64): (0.260, 0.276, 0.157, 33.206, None),
    ("gpu", 1, 128): (0.246, 0.257, 0.152, 36.856, None),
    ("gpu", 16, 8): (0.264, 0.266, 0.154, None, None),
    ("gpu", 16, 16): (0.258, 0.264, 0.175, None, None),
    ("gpu", 16, 32): (0.251, 0.268, 0.221, None, None),
    ("gpu", 16, 64): (0.280, 0.289, 0.301, None, None),
    ("gpu", 16, 128): (0.262, 0.272, 0.469, None, None),
}

TABLE_6_COLUMNS = (
    "reset_ms",
    "transition_ms",
    "metrics_ms",
    "rollout_ms",
    "peak_memory_mb",
)

# Steps per second with one observation each, by the number of vehicles that replay.
NOCTURNE_SINGLE_AGENT = {10: 4543.0, 20: 4049.0, 30: 3497.0}
# Agent-steps per second: 452 of each agent, of which there are 8.5 on average.
NOCTURNE_MULTI_AGENT = 452 * 8.5


def waymax(env: str, platform: str, batch: int, objects: int) -> dict[str, float]:
    """Returns the figures of the same setting by column; empty where there is none."""
    table_6 = WAYMAX_TABLE_6.get((platform, batch, objects), ())
    table_2 = WAYMAX_TABLE_2.get((env, platform, batch), ()) if objects == 128 else ()
    figures = dict(zip(TABLE_6_COLUMNS, table_6, strict=False))
    figures |= dict(zip(WAYMAX_COLUMNS, table_2, strict=False))
    return {name: float(x) for name, x in figures.items() if x is not None}


def nocturne(env: str, num_objects: float | int) -> float | None:
    """Returns the agent-steps per second of the most similar setting, if there is one.

    Args:
        env: the procedure.
        num_objects: how many are there, on average.
    """
    if env == "multi_agent":
        return NOCTURNE_MULTI_AGENT
    nearest = min(NOCTURNE_SINGLE_AGENT, key=lambda n: abs(n + 1 - num_objects))
    is_similar = abs(nearest + 1 - num_objects) < 0.2 * num_objects
    return NOCTURNE_SINGLE_AGENT[nearest] if is_similar else None
