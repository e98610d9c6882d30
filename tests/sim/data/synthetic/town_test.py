"""Tests of generated towns: pieces, lights and the zones where lanes meet."""

import itertools

import numpy as np
import pytest

from drivetrain.sim.data.synthetic import conflicts, signals, town as towns
from drivetrain.sim.data.synthetic.piece import Lane
from drivetrain.sim.data.synthetic.town import KINDS, Town
from drivetrain.sim.scenario import LightState, MapType

SEEDS = range(4)
NUM_STEPS = 900  # a whole cycle of lights and more
WIDTH = 2.0  # metres of a car
SHOWS_GO = (LightState.GO, LightState.ARROW_GO)


@pytest.fixture(scope="module")
def drawn() -> list[Town]:
    return [
        towns.draw(np.random.default_rng(seed), kind)
        for kind in KINDS
        for seed in SEEDS
    ]


def test_a_town_grows_around_its_kind(drawn: list[Town]) -> None:
    assert [t.kind for t in drawn[:: len(SEEDS)]] == list(KINDS)
    assert max(len(t.pieces) for t in drawn) > 5


def test_each_lane_but_those_at_the_border_goes_on(drawn: list[Town]) -> None:
    for t in drawn:
        goes_on = {a for a, _ in t.successor}
        for i, lane in enumerate(t.lanes):
            if lane.turn is not None and lane.map_type != MapType.LANE_BIKE:
                x, y = lane.line[-1]
                assert i in goes_on or np.hypot(x, y) > 40.0


def test_welding_lets_lanes_share_their_ends_exactly() -> None:
    ends = [0.0, 2.0**-16, -(2.0**-16)]  # what rounding may leave between them
    before = [
        Lane(line=np.array([[-5.0, y], [e, y + e]]), width=3.5, limit=10.0)
        for e, y in zip(ends, (0.0, 0.0, 0.0), strict=True)
    ]
    after = Lane(line=np.array([[0.0, 0.0], [5.0, 0.0]]), width=3.5, limit=10.0)
    welded = towns.welded([*before, after], [(0, 3), (1, 3), (2, 3)])
    for lane in welded[:3]:
        np.testing.assert_array_equal(lane.line[-1], welded[3].line[0])
        np.testing.assert_array_equal(lane.line[0], [-5.0, 0.0])


def test_neighbors_are_mutual(drawn: list[Town]) -> None:
    for t in drawn:
        assert {(b, a) for a, b in t.neighbor} == set(t.neighbor)


def test_pieces_that_do_not_touch_keep_apart(drawn: list[Town]) -> None:
    for t in drawn:
        lanes = [np.concatenate([q.line for q in p.lanes]) for p in t.pieces]
        ports = [np.array([[q.pose.x, q.pose.y] for q in p.ports]) for p in t.pieces]
        for i, j in itertools.combinations(range(len(lanes)), 2):
            if not len(ports[i]) or not len(ports[j]):
                continue
            gap = np.linalg.norm(ports[i][:, None] - ports[j], axis=-1)
            if gap.min() > 0.1:
                away = np.linalg.norm(lanes[i][::4, None] - lanes[j][::4], axis=-1)
                assert away.min() > 5.0, (t.kind, i, j)


def crossing(a: np.ndarray, b: np.ndarray) -> bool:
    """Tells if two lines properly cross."""

    def side(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    for p, q in itertools.pairwise(a[::2]):
        for r, s in itertools.pairwise(b[::2]):
            if np.hypot(*(p - r)) > 6.0:
                continue
            if side(p, q, r) * side(p, q, s) < 0 and side(r, s, p) * side(r, s, q) < 0:
                return True
    return False


def test_lights_never_let_crossing_ways_go_at_once(drawn: list[Town]) -> None:
    num_pairs = 0
    for t in drawn:
        for piece in t.pieces:
            if piece.signals is None:
                continue
            shown = signals.states(np.random.default_rng(0), piece.signals, NUM_STEPS)
            goes = np.isin(shown, SHOWS_GO)
            for a, b in itertools.combinations(piece.lanes, 2):
                both = goes[a.group] & goes[b.group]
                # A left turn may have to give way where no arrow protects it.
                if a.rank != b.rank or not both.any():
                    continue
                if np.linalg.norm(a.line[0] - b.line[0]) < 1.0:
                    continue  # they come from one lane
                assert not crossing(a.line, b.line), (a.turn, b.turn)
                num_pairs += 1
    assert num_pairs > 20


def test_every_group_of_lights_has_its_green_and_yellow(drawn: list[Town]) -> None:
    piece = next(p for t in drawn for p in t.pieces if p.signals is not None)
    assert piece.signals is not None
    shown = signals.states(np.random.default_rng(1), piece.signals, NUM_STEPS)
    for lane in piece.lanes:
        states = shown[lane.group]
        assert np.isin(states, SHOWS_GO).any()
        changes = [(a, b) for a, b in itertools.pairwise(states.tolist()) if a != b]
        arrow = LightState.ARROW_GO in states
        go, caution, stop = (
            (LightState.ARROW_GO, LightState.ARROW_CAUTION, LightState.ARROW_STOP)
            if arrow
            else (LightState.GO, LightState.CAUTION, LightState.STOP)
        )
        assert set(changes) <= {(go, caution), (caution, stop), (stop, go)}


def test_lanes_that_cross_have_a_zone(drawn: list[Town]) -> None:
    num_crossings = 0
    for t in drawn[:6]:
        zones = conflicts.zones(t)
        pairs = set(map(tuple, zones.lane.reshape(-1, 2).tolist()))
        for base, piece in zip(t.first_lane.tolist(), t.pieces, strict=True):
            if piece.kind != "junction":
                continue
            for a, b in itertools.combinations(range(len(piece.lanes)), 2):
                first, second = (t.lanes[base + i].line for i in (a, b))
                if (first[0] == second[0]).all():
                    continue  # who turns off follows, and needs no right of way
                if crossing(first, second):
                    assert (base + a, base + b) in pairs
                    num_crossings += 1
    assert num_crossings > 20


def test_of_two_lanes_that_meet_at_most_one_has_priority(drawn: list[Town]) -> None:
    for t in drawn:
        yields = conflicts.zones(t).yields
        assert (yields[::2] == -yields[1::2]).all()


def test_cars_outside_a_zone_cannot_touch_there(drawn: list[Town]) -> None:
    for t in drawn[:6]:
        zones = conflicts.zones(t)
        for side in range(0, len(zones.lane), 2):
            a, b = (t.lanes[zones.lane[side + k]].line for k in range(2))
            station = np.append(0.0, np.cumsum(np.hypot(*np.diff(a, axis=0).T)))
            free = (station < zones.begin[side] - 0.8) | (
                station > zones.end[side] + 0.8
            )
            if free.any():
                away = np.linalg.norm(a[free][:, None] - b, axis=-1)
                assert away.min() > WIDTH
