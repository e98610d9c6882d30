"""Tests where the ego is along its ways against the oracle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.sim.metrics import route
from drivetrain.sim.scenario import Scenario
from tests import changes, worlds
from tests.oracles import routes as oracle


def ego_log(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Returns the logged positions of the ego, and where they mean something."""
    xyz = scenario.tracks.xyz[scenario.ego_index] - scenario.origin
    return xyz[:, :2], scenario.tracks.valid[scenario.ego_index]


def places(moment) -> np.ndarray:
    """Returns where the ego is, by up to a millimetre."""
    return np.float64(moment.after.xy[0]) + worlds.NUDGES


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_progress_is_that_of_the_oracle(kind: str) -> None:
    for scenario, moment, measures in worlds.samples(kind):
        assert scenario.paths is not None
        ratios = [
            oracle.progress_ratio(
                place,
                worlds.paths_of(scenario),
                scenario.paths.on_route,
                *ego_log(scenario),
            )
            for place in places(moment)
        ]
        # An error of position is divided by how far the log got.
        log_xy, log_valid = ego_log(scenario)
        ends = log_xy[log_valid][[0, -1]]
        slack = worlds.ROUNDING / max(1.0, float(np.linalg.norm(ends[1] - ends[0])))
        low, high = min(ratios) - slack, max(ratios) + slack
        assert measures["progress"].valid
        assert low <= measures["progress"].value <= high


@pytest.mark.parametrize("kind", worlds.KINDS)
def test_leaving_the_route_is_that_of_the_oracle(kind: str) -> None:
    for scenario, moment, measures in worlds.samples(kind):
        assert scenario.paths is not None
        paths, on_route = worlds.paths_of(scenario), scenario.paths.on_route
        answers = [oracle.off_route(place, paths, on_route) for place in places(moment)]
        verdict = bool(measures["offroute"].value > 0)
        assert verdict in [verdict for verdict, _ in answers]
        distance = float(measures["route_distance"].value)
        assert distance == pytest.approx(answers[0][1], abs=worlds.ROUNDING)


@pytest.mark.parametrize("index", range(3))
def test_the_route_is_left_where_the_oracle_says(index: int) -> None:
    scenario, moment, _ = worlds.samples("generated")[3 * index]
    assert scenario.paths is not None
    paths, on_route = worlds.paths_of(scenario), scenario.paths.on_route
    for offset in np.float32(np.arange(-9, 9, 0.37)):
        xyz = moment.logged.xyz.at[0, :2].add(offset)
        moved = moment.replace(after=moment.logged.replace(xyz=xyz))
        verdict, _ = oracle.off_route(np.float64(xyz[0, :2]), paths, on_route)
        assert bool(worlds.measure(moved)["offroute"].value > 0) is verdict


def test_the_samples_leave_the_route_and_keep_to_it() -> None:
    off = [float(s.measures["offroute"].value) for s in worlds.samples("generated")]
    assert 0 < np.mean(off) < 1


def fork(y: float) -> route.PathSegments:
    """Returns two on-route paths east from the origin, 4 m and y metres to the left."""
    side = jnp.array([4.0, y])
    return route.PathSegments(
        start=jnp.stack([jnp.zeros(2), side], -1),
        end=jnp.stack([jnp.full(2, 50.0), side], -1),
        arc=jnp.array([0.0, 100.0]),
        path=jnp.array([0, 1]),
        speed_limit=jnp.zeros(2),
        is_limited=jnp.zeros(2, bool),
        on_route=jnp.array([True, True]),
        log_arc=jnp.zeros((2, 2)),
        valid=jnp.array([True, True]),
    )


@pytest.mark.parametrize(("y", "path"), [(4.09, 0), (4.11, 1), (-4.0, 0)])
def test_of_paths_equally_near_the_first_counts(y: float, path: int) -> None:
    side = 10.0 if y > 0 else 0.0
    assert int(route.locate(fork(y), jnp.array([20.0, side])).path) == path


def test_without_an_off_route_path_only_the_distance_counts() -> None:
    place = route.locate(fork(5.0), jnp.array([20.0, 8.0]))
    assert np.isinf(place.off_route_distance)
    assert float(place.distance) == pytest.approx(3.0, abs=1e-6)


def test_the_gradient_of_progress_is_finite_on_the_path_and_off_it() -> None:
    for scenario, moment, _ in worlds.samples("generated")[::6]:
        on_path = worlds.paths_of(scenario)[0][3].astype(np.float32)

        def ratio(xy: jax.Array, moment=moment) -> jax.Array:
            xyz = moment.after.xyz.at[0, :2].set(xy)
            moved = moment.replace(after=moment.after.replace(xyz=xyz))
            return route.progress(moved, jnp.int32(0)).value

        for xy in (on_path, on_path + 1, np.float32(moment.logged.xy[0])):
            assert np.isfinite(jax.jit(jax.grad(ratio))(jnp.asarray(xy))).all()


@pytest.mark.parametrize("name", ["progress", "offroute", "route_distance"])
@pytest.mark.parametrize("change", changes.CHANGES)
def test_the_place_on_the_route_is_kept(change: str, name: str) -> None:
    changes.assert_kept(change, name, 0 if name == "offroute" else worlds.ROUNDING)
