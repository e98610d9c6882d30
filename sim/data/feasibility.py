"""Tells which objects could reach their goals without a crossing of road edges."""

import numpy as np
from jaxtyping import Bool, Float

from ..scenario import SAME_LEVEL

# N app. E says the box is shrunk "by" these; its figure of 3 % took them as factors.
LENGTH_FACTOR = 0.3
WIDTH_FACTOR = 0.1
BRANCHES = 8  # the steps of a log are searched in runs of 64, 8 and 1
LONGEST_RUN = BRANCHES**2


def goal_feasible(
    xyz: Float[np.ndarray, "objects steps 3"],
    yaw: Float[np.ndarray, "objects steps"],
    size: Float[np.ndarray, "objects 3"],
    valid: Bool[np.ndarray, "objects steps"],
    edges: Float[np.ndarray, "vertices 3"],
    joined: Bool[np.ndarray, " vertices"],
) -> Bool[np.ndarray, " objects"]:
    """Returns False for objects whose log crosses a road edge (N app. E).

    It does where the box, shrunk to 0.1 of its width and 0.3 of its length, touches an
    edge of its level at a valid step.

    Args:
        xyz: centres of the boxes [m], in the frame of the edges.
        yaw: of the boxes [rad].
        size: length, width and height [m].
        valid: where the log means something.
        edges: vertices of all road edges, one after the other [m].
        joined: whether a segment leads from the vertex to the next one.
    """
    first = np.flatnonzero(joined)
    start, end = edges[first], edges[first + 1]
    half = size[:, None, :2] * (LENGTH_FACTOR / 2, WIDTH_FACTOR / 2)
    forward = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    reach = np.abs(forward) * half[..., :1] + np.abs(forward[..., ::-1]) * half[..., 1:]
    low = np.where(valid[..., None], xyz[..., :2] - reach, np.inf)
    high = np.where(valid[..., None], xyz[..., :2] + reach, -np.inf)

    row, segment = _near_pairs(
        low,
        high,
        np.minimum(start, end)[:, :2],
        np.maximum(start, end)[:, :2],
    )
    number, step = np.divmod(row, _padded_length(valid.shape[1]))
    touches = _touches(
        xyz[number, step],
        forward[number, step],
        half[number, 0],
        start[segment],
        end[segment],
    )
    feasible = np.ones(len(size), bool)
    feasible[number[touches]] = False
    return feasible


def _padded_length(num_steps: int) -> int:
    return -(-num_steps // LONGEST_RUN) * LONGEST_RUN


def _near_pairs(low, high, segment_low, segment_high):
    """Returns the pairs of object-step and segment whose upright bounds meet.

    Runs of steps that stay away from a segment are dropped as a whole.
    """
    pad = _padded_length(low.shape[1]) - low.shape[1]
    low = np.pad(low, [(0, 0), (0, pad), (0, 0)], constant_values=np.inf)
    high = np.pad(high, [(0, 0), (0, pad), (0, 0)], constant_values=-np.inf)

    def meet(length, run, segment):
        run_low = low.reshape(-1, length, 2).min(axis=1)
        run_high = high.reshape(-1, length, 2).max(axis=1)
        in_x, in_y = (
            (run_low[run, axis] <= segment_high[segment, axis])
            & (segment_low[segment, axis] <= run_high[run, axis])
            for axis in range(2)
        )
        return in_x & in_y

    num_runs = low.size // (2 * LONGEST_RUN)
    every_run, every_segment = np.ogrid[:num_runs, : len(segment_low)]
    run, segment = np.nonzero(meet(LONGEST_RUN, every_run, every_segment))
    for length in (BRANCHES, 1):
        run = (BRANCHES * run[:, None] + np.arange(BRANCHES)).ravel()
        segment = np.repeat(segment, BRANCHES)
        kept = meet(length, run, segment)
        run, segment = run[kept], segment[kept]
    return run, segment


def _touches(xyz, forward, half, start, end):
    """Tells whether each box touches its segment, by separating axes."""
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=1)
    offset, along = (start - xyz)[:, :2], (end - start)[:, :2]
    touches = np.ones(len(xyz), bool)
    for axis, reach in ((forward, half[:, 0]), (left, half[:, 1])):
        a = (offset * axis).sum(axis=1)
        b = a + (along * axis).sum(axis=1)
        touches &= (np.minimum(a, b) <= reach) & (np.maximum(a, b) >= -reach)
    distance = np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0])
    touches &= distance <= half[:, 0] * np.abs(_cross(forward, along)) + half[
        :, 1
    ] * np.abs((forward * along).sum(axis=1))

    height = (start[:, 2] + end[:, 2]) / 2
    return touches & (np.abs(height - xyz[:, 2]) <= SAME_LEVEL)


def _cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
