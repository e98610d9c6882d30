"""Oracle of the route metrics: Waymax paper 3.4, `definitions.md` section 3."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from . import geometry

MIN_LOG_PROGRESS = 1e-3  # metres; a log that gets less far along its path stands still
SAME_PLACE = 0.1  # metres; paths share lanes, and those this equally near are tied
MAX_DISTANCE = 5.0  # metres from the on-route paths
MAX_EXCESS = 2.0  # metres farther from the on-route paths than from an off-route one


def progress_ratio(
    xy: Float[np.ndarray, " 2"],
    paths: Sequence[Float[np.ndarray, "points 2"]],
    on_route: Bool[np.ndarray, " paths"],
    log_xy: Float[np.ndarray, "steps 2"],
    log_valid: Bool[np.ndarray, " steps"],
) -> float:
    """Returns how far the ego is along its route, as a part of what the log drove.

        (d - d_p) / (d_q - d_p)

    d, d_p and d_q are the arc lengths of the ego, of the first and of the last valid
    logged position, all on the on-route path nearest to the ego. Of paths whose
    distance is within 0.1 m of the least, the first in order counts.

    Args:
        xy: the ego's position [m].
        paths: of at least two points each [m].
        on_route: which paths follow the road that the log took.
        log_xy: the ego's logged positions [m].
        log_valid: where these mean something.

    Returns:
        The ratio, which may exceed 1; 1 where the log stands still along the path.

    Raises:
        ValueError: if no path is on-route, or no logged position is valid.
    """
    if not np.any(on_route) or not np.any(log_valid):
        raise ValueError("progress needs an on-route path and a valid logged position")
    candidates = [path for path, on in zip(paths, on_route, strict=True) if on]
    distances = np.array([geometry.project(xy, path)[0] for path in candidates])
    path = candidates[int(np.argmax(distances <= distances.min() + SAME_PLACE))]

    valid_log = log_xy[log_valid]
    _, d = geometry.project(xy, path)
    _, d_p = geometry.project(valid_log[0], path)
    _, d_q = geometry.project(valid_log[-1], path)
    if abs(d_q - d_p) < MIN_LOG_PROGRESS:
        return 1.0
    return (d - d_p) / (d_q - d_p)


def off_route(
    xy: Float[np.ndarray, " 2"],
    paths: Sequence[Float[np.ndarray, "points 2"]],
    on_route: Bool[np.ndarray, " paths"],
) -> tuple[bool, float]:
    """Tells whether the ego has left its route, and how far it is from it.

    Off-route is farther than 5 m from every on-route path, or more than 2 m farther
    from the on-route paths than from some off-route path.

    Args:
        xy: the ego's position [m].
        paths: of at least two points each [m].
        on_route: which paths follow the road that the log took.

    Returns:
        The verdict and the distance to the nearest on-route path [m], which is infinite
        where there is none.
    """
    from_on = from_off = np.inf
    for path, on in zip(paths, on_route, strict=True):
        distance, _ = geometry.project(xy, path)
        if on:
            from_on = min(from_on, distance)
        else:
            from_off = min(from_off, distance)
    return bool(from_on > MAX_DISTANCE or from_on > from_off + MAX_EXCESS), from_on


def wrong_way(
    xy: Float[np.ndarray, " 2"],
    paths: Sequence[Float[np.ndarray, "points 2"]],
    max_distance: float = 3.5,
) -> tuple[bool, float]:
    """Tells whether the ego is far from every path, and how far it is from them [m]."""
    distance = min(geometry.project(xy, path)[0] for path in paths)
    return distance > max_distance, distance
