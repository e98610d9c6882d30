"""Tests that benchmarks measure what they say, and write it down."""

import csv
import dataclasses
import html
import json
import pathlib
import sys
import time
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drivetrain.launch import benchmark as benchmarking, cli
from drivetrain.launch.benchmarks import published, scenes, timing
from drivetrain.launch.benchmarks.base import Settings
from drivetrain.launch.benchmarks.nocturne_speed import nocturne_speed, random_vehicle
from drivetrain.launch.benchmarks.runtime import TASKS, runtime
from drivetrain.launch.benchmarks.throughput import throughput
from drivetrain.sim.metrics.collision import COLLISION
from drivetrain.sim.metrics.displacement import DISPLACEMENT
from drivetrain.sim.observations.base import Observer, TokenGroup
from drivetrain.sim.observations.vector import VectorConfig
from drivetrain.sim.scenario import ObjectType
from drivetrain.sim.scene import Scene
from drivetrain.sim.sim_agents.playback import PLAYBACK
from tests import worlds

TABLES = pathlib.Path(__file__).resolve().parents[3] / "shared/tables"
ROUNDING = 1e-6  # of float32, where one program is compiled otherwise than another
SMALL = Settings(
    data="synthetic:0:3", scenarios=2, objects=(4,), batches=(2,), seconds=0.001
)
COMMON = {"env", "batch", "objects", "valid_objects", "device", "jax", "data"}
RUNTIME = {f"{what}_ms" for what in ("reset", "step", "transition", "metrics")}
RUNTIME |= {"rollout_ms", "observation_ms", "peak_memory_mb"}


def _see_speed(view, number):
    speed = view.motion.speed[-1:, number, None]
    return {"ego": TokenGroup(values=speed[None], mask=jnp.ones((1, 1), bool))}


SPEED = Observer(history=0, observe=_see_speed, describe=lambda: ())
BENCHMARKS = {
    "runtime": (runtime((COLLISION,), VectorConfig(history=0, num_road=5)), RUNTIME),
    "nocturne": (nocturne_speed(SPEED), {"agents", "step_ms", "agent_steps_per_s"}),
    "throughput": (
        throughput(SPEED),
        {"step_ms", "observed_step_ms", "agent_steps_per_s", "process_mb"},
    ),
}


@pytest.fixture(scope="module", params=list(BENCHMARKS))
def written(request, tmp_path_factory) -> tuple[str, pathlib.Path]:
    """The folder to which a small benchmark has written all that it can."""
    out = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        small = {name: chosen for name, (chosen, _) in BENCHMARKS.items()}
        patch.setattr(benchmarking, "BENCHMARKS", small)
        benchmarking.benchmark(request.param, SMALL, out / "rows.json", out / "report")
    return request.param, out


def test_each_row_has_its_fields_and_positive_figures(written) -> None:
    name, out = written
    rows = json.loads((out / "rows.json").read_text())
    assert [row["env"] for row in rows] == list(BENCHMARKS[name][0].envs)
    for row in rows:
        assert {*row} >= COMMON | BENCHMARKS[name][1]
        assert (row["batch"], row["objects"]) == (2, 4)
        assert 0 < row["valid_objects"] <= 4
        assert all(x > 0 for x in row.values() if isinstance(x, float))
        for key in [key for key in row if key.endswith("_q1")]:
            median = row[key.removesuffix("_q1")]
            assert row[key] <= median <= row[key.replace("_q1", "_q3")]


def test_the_report_shows_table_and_plots_without_other_files(written) -> None:
    name, out = written
    page = html.unescape((out / "report" / "report.html").read_text())
    plots = {path.stem for path in (out / "report").glob("*.svg")}
    assert plots == {path.stem for path in (out / "report").glob("*.png")}
    assert page.count('src="data:image/svg+xml;base64,') == len(plots) > 0
    assert f"<h1>Drivetrain: {BENCHMARKS[name][0].title}</h1>" in page
    assert "multi_agent" in page and jax.__version__ in page
    assert "http" not in page
    for plot in plots:
        ElementTree.parse(out / "report" / f"{plot}.svg")
        assert (out / "report" / f"{plot}.png").read_bytes().startswith(b"\x89PNG")


def test_programs_too_large_are_not_run_but_their_need_is_told() -> None:
    settings = dataclasses.replace(SMALL, max_memory_gb=1e-9)
    chosen = throughput(SPEED)
    (cell,) = chosen.cells(settings)
    row = chosen.measure(settings, scenes.load(SMALL.data, 2), cell)
    assert "step_ms" not in row and "observed_agent_steps_per_s" not in row
    assert row["peak_memory_mb"] > 1e-6 and row["observed_peak_memory_mb"] > 1e-6


def test_times_are_median_and_quartiles_of_calls_that_go_round_the_inputs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    durations = [3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0]  # seconds
    ticks = iter(np.cumsum([x for d in durations for x in (0.0, d)]))
    monkeypatch.setattr(time, "perf_counter", lambda: next(ticks))
    called = []
    program = timing.Program(call=called.append, compile_s=0.0, memory_mb=0.0)
    measured = timing.measure(program, [("a",), ("b",)], seconds=sum(durations))
    assert called == ["a", "b", *"abababa"]
    quartiles = np.percentile(durations, [25, 50, 75]) * 1e3
    found = [measured.lower, measured.median, measured.upper]
    assert found == pytest.approx(list(quartiles))


def test_a_short_time_still_gives_quartiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "perf_counter", iter(range(100)).__next__)
    called = []
    program = timing.Program(call=called.append, compile_s=0.0, memory_mb=0.0)
    timing.measure(program, [("a",)], seconds=0.5)
    assert len(called) == 1 + 5


def test_the_memory_of_a_program_has_its_arguments_and_results() -> None:
    block = jnp.zeros(250_000, jnp.float32)  # a megabyte
    program = timing.compile(lambda x, y: (x + y, x - y), (block, block))
    assert program.memory_mb == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("env", list(TASKS))
def test_a_step_is_its_transition_its_metrics_and_their_negative_sum(env: str) -> None:
    task = TASKS[env]((COLLISION, DISPLACEMENT), PLAYBACK)
    bank = worlds.bank("generated")

    @jax.jit
    def both_ways(index):
        state = task.reset(bank, index, jax.random.key(0))
        action = jax.tree.map(lambda x: x + 0.1, task.expert(bank, state))
        following = task.transition(bank, state, action)
        apart = following, task.metrics(bank, state, following)
        return apart, task.step(bank, state, action)

    for index in range(3):
        (following, measures), (stepped, (together, reward)) = both_ways(index)
        jax.tree.map(np.testing.assert_array_equal, following.motion, stepped.motion)
        assert float(measures["log_displacement"].value[0]) > 0
        for name, measure in measures.items():
            valid = np.asarray(together[name].valid)
            np.testing.assert_allclose(
                measure.value[valid], together[name].value[valid], rtol=ROUNDING
            )
        total = sum(m.value[0] * m.valid[0] for m in measures.values())
        assert float(np.ravel(reward)[0]) == pytest.approx(-float(total), rel=ROUNDING)


def test_the_random_agent_is_any_vehicle_that_is_there_and_nobody_else() -> None:
    bank = worlds.bank("generated")
    scene = Scene(bank=bank, index=jnp.int32(1))
    task = TASKS["multi_agent"]((COLLISION,), PLAYBACK)
    state = jax.jit(task.reset)(bank, scene.index, jax.random.key(0))
    gone = state.motion.valid.at[0].set(False)
    state = state.replace(motion=state.motion.replace(valid=gone))
    is_car = np.asarray(scene.object_type) == ObjectType.VEHICLE
    there = np.flatnonzero(is_car & np.asarray(state.motion.valid))

    keys = jax.random.split(jax.random.key(1), 60 * len(there))
    choose = jax.vmap(random_vehicle, in_axes=(None, None, 0))
    states, numbers, looks = choose(bank, state, keys)
    assert is_car[0] and {*np.ravel(numbers)} == {*there} and looks.all()
    np.testing.assert_array_equal(np.argmax(states.teams[0], axis=1), numbers[:, 0])
    assert (np.asarray(states.teams[0]).sum(axis=1) == 1).all()


def test_the_fullest_scenarios_are_kept_and_all_banks_have_the_slots_asked_for() -> (
    None
):
    everything = scenes.load("synthetic:0:6", 6).scenarios
    chosen = scenes.load("synthetic:0:6", 2)
    counts = sorted((len(s.object_id) for s in everything), reverse=True)
    assert [len(s.object_id) for s in chosen.scenarios] == counts[:2]
    for slots in (3, 50):
        bank = chosen.bank(slots)
        masks = [np.asarray(worlds.scene(bank, i).object_mask) for i in range(2)]
        assert all(len(mask) == slots for mask in masks)
        assert [mask.sum() for mask in masks] == [min(n, slots) for n in counts[:2]]


def _rows(name: str) -> list[dict[str, str]]:
    path = TABLES / name
    if not path.exists():
        pytest.skip("the tables of ../shared are not here")
    with path.open() as file:
        return list(csv.DictReader(file))


def test_published_figures_of_waymax_are_those_of_its_tables() -> None:
    printed = {}
    for row in _rows("waymax_table6_objects_ablation.csv"):
        for env in ("planning", "multi_agent"):
            place = env, row["device"], int(row["batch"]), int(row["objects"])
            printed[place] = {k: float(v) for k, v in list(row.items())[3:] if v}
    names = {"reset": "reset_ms", "step": "step_ms", "rollout_expert": "rollout_ms"}
    names |= {"transition": "transition_ms", "metrics": "metrics_ms"}
    for row in _rows("waymax_table2_runtime_ms.csv"):
        device = row["device"].replace("v100", "gpu")
        place = row["env"], device, int(row["batch"]), 128
        printed[place] |= {names[k]: float(row[k]) for k in names if row[k]}
    for place, figures in printed.items():
        if "rollout_expert_ms" in figures:
            rollout = figures.pop("rollout_expert_ms")
            figures.setdefault("rollout_ms", rollout)
        assert published.waymax(*place) == figures
    assert published.waymax("planning", "cpu", 2, 128) == {}


def test_published_figures_of_nocturne_are_those_of_its_appendix() -> None:
    rows = _rows("nocturne_speed.csv")
    for row in rows:
        if row["non_agent_vehicles"].isdecimal():
            slots = int(row["non_agent_vehicles"]) + 1
            figure = published.nocturne("single_agent", slots)
            assert figure == float(row["steps_per_second"])
    # "about 3800 frames of experience per second" is rounded to hundreds.
    assert published.nocturne("multi_agent", 20) == pytest.approx(3800, abs=50)
    assert published.nocturne("single_agent", 16) is None


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--objects", "8;16"], "objects must be whole numbers such as 8,16"),
        (["--objects", "0"], "objects must be from 1 to 65,536, got 0."),
        (["--batches", "1,,2"], "batches must be whole numbers"),
        (["--scenarios", "0"], "scenarios must be at least 1, got 0."),
        (["--seconds", "0"], "seconds must be positive and finite, got 0.0."),
        (["--max-memory-gb", "inf"], "max_memory_gb must be positive and finite"),
        ([], "no file matches 'nowhere/*.x'"),
        (["--json", "."], "--json '.' is a folder; name a file in it."),
    ],
)
def test_wrong_options_end_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: pathlib.Path,
    capsys: pytest.CaptureFixture,
    words: list[str],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    # Without data, so that an option that is wrongly let through starts nothing long.
    argv = ["drivetrain", "benchmark", "--data", "nowhere/*.x", *words]
    monkeypatch.setattr(sys, "argv", argv)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    error = capsys.readouterr().err.strip()
    assert stop.value.code == 2
    assert sentence in error and len(error.splitlines()) == 1
    assert not list(tmp_path.iterdir())
