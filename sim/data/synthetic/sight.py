"""Decides when road users are seen: within range, and not hidden."""

import numpy as np
from jaxtyping import Bool, Float

from .log import PlanarTracks

RANGE = (58.0, 85.0)  # metres, the farthest at which things are seen in a scenario
CLEAR = 14.0  # metres within which nothing is hidden
SHARE_FAR = 0.3  # of the time in which things at the range are seen
SWITCHING = 0.032  # chance in a step to be seen or hidden anew


def seen(
    generator: np.random.Generator, tracks: PlanarTracks
) -> Bool[np.ndarray, "objects steps"]:
    """Returns where objects are seen; the first is the ego, and sees itself.

    At each distance objects are seen for a certain share of the time, less the farther
    they are: a chain with two states, hidden and seen, has that share in the long run.
    """
    farthest = generator.uniform(*RANGE)
    gap = tracks.xy - tracks.xy[:1]
    distance = np.sqrt(gap[..., 0] ** 2 + gap[..., 1] ** 2)
    share = np.clip((distance - CLEAR) / (farthest - CLEAR), 0.0, 1.0)
    share = 1.0 - (1.0 - SHARE_FAR) * share
    chance = generator.uniform(size=share.shape)
    is_seen = _chain(share, chance)
    result = is_seen & (distance < farthest) & tracks.valid
    result |= (distance < CLEAR) & tracks.valid
    result[0] = tracks.valid[0]
    return result


def _chain(
    share: Float[np.ndarray, "objects steps"],
    chance: Float[np.ndarray, "objects steps"],
) -> Bool[np.ndarray, "objects steps"]:
    now = chance[:, 0] < share[:, 0]
    states = [now]
    for t in range(1, share.shape[1]):
        hides = chance[:, t] < SWITCHING * (1 - share[:, t])
        shows = chance[:, t] < SWITCHING * share[:, t]
        now = np.where(now, ~hides, shows)
        states.append(now)
    return np.stack(states, axis=1)
