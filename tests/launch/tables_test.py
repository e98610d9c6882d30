"""Tests that tables say what the episodes say, and line up."""

import io
import json
import pathlib

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console

from drivetrain.launch import tables

# 300 intervals at 95 %: five standard deviations of the covered share are 6 points; the
# percentile interval of 100 episodes itself covers a point or two less than it says.
COVERAGE = (0.87, 1.0)


def row(agent: str = "dqn", num_episodes: int = 100, seed: int = 0) -> tables.Row:
    """Makes a row of random episodes."""
    rng = np.random.default_rng(seed)
    episodes = {
        "collision": rng.random(num_episodes) < 0.3,
        "kinematic": np.zeros(num_episodes, bool),
        "log_ade": rng.gamma(2.0, 1.2, num_episodes),
        "progress": rng.normal(1.0, 0.3, num_episodes),
    }
    return tables.summarize(episodes, agent=agent, sim_agent="idm", seed=seed)


def printed(rows: list[tables.Row], width: int) -> list[str]:
    """Returns the lines of the table as they leave a pipe."""
    out = io.StringIO()
    tables.show(rows, "Planning", Console(file=out, width=width))
    return out.getvalue().splitlines()


def test_a_row_holds_rates_in_percent_and_means() -> None:
    episodes = {
        "collision": np.array([True, False, False, False]),
        "log_ade": np.array([1.0, 2.0, 3.0, 6.0]),
        "progress": np.array([1.0, 0.5, 1.0, 1.5]),
    }
    made = tables.summarize(episodes, agent="dqn", sim_agent="idm", seed=3)
    expected = {
        "agent": "dqn",
        "sim_agent": "idm",
        "episodes": 4,
        "collision_pct": 25.0,
        "log_ade_m": 3.0,
        "progress_pct": 100.0,
        "bootstrap_seed": 3,
    }
    assert expected.items() <= made.items()


def test_absent_values_are_left_out_and_counted() -> None:
    episodes = {
        "progress": np.array([0.5, 9.0, np.nan, 1.5]),
        "progress_mask": np.array([True, False, True, True]),
    }
    made = tables.summarize(episodes, agent="dqn", sim_agent="idm", seed=0)
    assert (made["progress_pct"], made["progress_episodes"]) == (100.0, 2)
    assert "Progress of dqn with idm is over 2 of 4 episodes" in " ".join(
        tables.notes([made])
    )


def test_a_metric_without_any_value_is_null() -> None:
    episodes = {"progress": np.array([np.nan]), "collision": np.array([True])}
    made = tables.summarize(episodes, agent="dqn", sim_agent="idm", seed=0)
    assert made["progress_pct"] is None
    assert made["progress_episodes"] == 0


@pytest.mark.parametrize("lengths", [(0, 0), (3, 4)])
def test_episodes_that_do_not_match_are_refused(lengths: tuple[int, int]) -> None:
    episodes = {"collision": np.ones(lengths[0]), "offroad": np.ones(lengths[1])}
    with pytest.raises(ValueError, match="one value per episode"):
        tables.summarize(episodes, agent="dqn", sim_agent="idm", seed=0)


def test_the_interval_covers_the_true_rate_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    rate, covered = 0.3, []
    for _ in range(300):
        episodes = {"collision": rng.random(100) < rate}
        made = tables.summarize(episodes, agent="a", sim_agent="b", seed=0)
        low, high = made["collision_pct_low"], made["collision_pct_high"]
        covered.append(low <= 100 * rate <= high)
    assert COVERAGE[0] <= np.mean(covered) <= COVERAGE[1]
    assert not all(covered)


def test_the_interval_is_that_of_the_binomial_distribution() -> None:
    episodes = {"collision": np.arange(10_000) < 3000}
    made = tables.summarize(episodes, agent="a", sim_agent="b", seed=0)
    # Resampled flags are binomial: 30 +- 1.96 * 100 * sqrt(0.3 * 0.7 / 10,000). The
    # bounds out of 1000 resamples waver by a twentieth of the width, 0.09, once in 20.
    bounds = made["collision_pct_low"], made["collision_pct_high"]
    assert bounds == pytest.approx((29.10, 30.90), abs=0.12)


def test_a_seed_gives_the_same_interval_each_time() -> None:
    assert row(seed=4) == row(seed=4)


def test_the_row_over_seeds_is_their_mean_and_deviation() -> None:
    rows: list[tables.Row] = [
        {"agent": "dqn", "sim_agent": "idm", "episodes": 9, "collision_pct": value}
        for value in (4.0, 5.0, 6.0)
    ]
    assert tables.over_seeds(rows) == {
        "agent": "dqn",
        "sim_agent": "idm",
        "episodes": 9,
        "seeds": 3,
        "collision_pct": 5.0,
        "collision_pct_std": 1.0,
    }


def test_rows_of_seeds_and_of_their_mean_say_what_they_are() -> None:
    # Of few episodes one has no progress, which is to be said once.
    values = np.array([0.5, 1.0, np.nan])
    rows = [
        tables.summarize({"progress": values}, agent="dqn", sim_agent="idm", seed=0)
        | {"run_seed": number}
        for number in range(2)
    ]
    lines = printed([*rows, tables.over_seeds(rows)], 120)
    firsts = [line.split("  ")[0] for line in lines if line.startswith("dqn")]
    assert firsts == ["dqn/seed0", "dqn/seed1", "dqn/mean"]
    assert " ".join(" ".join(lines).split()).count("is over 2 of 3 episodes") == 1


def test_seeds_of_several_agents_are_not_joined() -> None:
    with pytest.raises(ValueError, match="seeds of one agent"):
        tables.over_seeds([row("dqn"), row("bc")])


@pytest.mark.parametrize("width", [80, 120])
def test_columns_line_up(width: int) -> None:
    lines = printed([row(), row("wayformer, replanned", 12_345, 1)], width)
    body = lines[1 : next(i for i, line in enumerate(lines) if "Ranges" in line)]
    edge = body[0].index("Log ADE") + len("Log ADE")
    assert {line[edge] for line in body} == {" ", "\N{BOX DRAWINGS LIGHT HORIZONTAL}"}


@pytest.mark.parametrize("width", [80, 120])
def test_lines_are_of_one_width_and_fit(width: int) -> None:
    lines = printed([row(), row("每五步重新规划的轨迹", 12_345, 1)], width)
    body = lines[1 : next(i for i, line in enumerate(lines) if "Ranges" in line)]
    assert len({cell_len(line) for line in body}) == 1
    assert max(cell_len(line) for line in lines) <= width


def test_no_figure_is_cut_at_80_columns() -> None:
    full = {column.metric: np.ones(400) for column in tables.COLUMNS}
    made = tables.summarize(full, agent="dqn", sim_agent="constant_speed", seed=0)
    text = "\n".join(printed([made], 80))
    num_rates = sum(column.unit == "%" for column in tables.COLUMNS)
    assert text.count("100.00") == num_rates
    assert text.count("100\N{EN DASH}100") == num_rates
    assert "constant_speed" in text
    assert "…" not in text


def test_metrics_that_do_not_fit_stand_below_beside_the_same_names() -> None:
    full = {column.metric: np.ones(400) for column in tables.COLUMNS}
    made = tables.summarize(full, agent="dqn", sim_agent="idm", seed=0)
    text = "\n".join(printed([made], 80))
    assert text.count("dqn") == text.count("400") == 2
    assert text.count("Planning") == text.count("Ranges are") == 1
    assert all(text.count(column.title) == 1 for column in tables.COLUMNS)


def test_metrics_that_no_row_has_get_no_column() -> None:
    keys = [column.key for column in tables.columns_of([row()])]
    assert "offroad_pct" not in keys


def test_rows_are_read_back_from_json(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "new" / "rows.json"
    rows = [row(), row("bc", 7)]
    tables.write_json(path, rows)
    assert json.loads(path.read_text()) == rows
    assert [*path.parent.iterdir()] == [path]


def test_a_failed_write_leaves_the_old_rows(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "rows.json"
    tables.write_json(path, [row()])
    with pytest.raises(ValueError, match="not JSON compliant"):
        tables.write_json(path, [{"agent": "dqn", "collision_pct": float("nan")}])
    assert json.loads(path.read_text()) == [row()]
